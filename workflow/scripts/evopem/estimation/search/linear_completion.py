"""Coordinates in which the residuals are linear, by Newton steps from zero."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.search.staged_descent import PredictionErrors, damped_inverses

Array = NDArray[np.float64]

# Newton steps: one is exact for the quadratic objective.
LINEAR_STEPS = {"quadratic": 1, "absolute": 4}


def solve_linear(
    errors: PredictionErrors, points: Array, linear: NDArray[np.bool_], steps: int
) -> Array:
    """Points whose linear coordinates minimise the objective, given the others.

    Parameters
    ----------
    errors : PredictionErrors
    points : (M, n) array
        Changed in place.
    linear : (n,) array of bool
    steps : int
        Newton steps: :data:`LINEAR_STEPS`.
    """
    none = np.zeros(len(points))
    for _ in range(steps):
        size = errors.mean_absolute_residuals(errors.values(points))
        size = np.where(np.isfinite(size) & (size > 0.0), size, 1.0)
        _, gradients = errors.values_and_gradients(points, size, none)
        matrices = errors.curvatures(points, size, none)[:, linear][:, :, linear]
        inverses = damped_inverses(matrices)
        points[:, linear] -= np.einsum("ijk,ik->ij", inverses, gradients[:, linear])
    return points
