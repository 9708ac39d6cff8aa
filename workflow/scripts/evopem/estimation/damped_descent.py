"""Steps and ends of damped Gauss-Newton descents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where a descent ended.

    Attributes
    ----------
    point : (n,) array
    value : float
        Of what is minimised; infinite where no feasible point was found.
    converged : bool
    evaluations : int
        A Jacobian counts as one.
    """

    point: Array
    value: float
    converged: bool
    evaluations: int


def damped_step(hessian: Array, gradient: Array, damping: float) -> Array | None:
    """Damped Gauss-Newton step in scaled coordinates, or None where it does not exist."""
    matrix = hessian.copy()
    # Far below the damping, this keeps free directions of the coordinates solvable.
    matrix[np.diag_indices_from(matrix)] += damping + 1e-12
    try:
        factor = cho_factor(matrix, lower=True, check_finite=False)
    except LinAlgError:
        return None
    step: Array = -cho_solve(factor, gradient, check_finite=False)
    return step if np.isfinite(step).all() else None
