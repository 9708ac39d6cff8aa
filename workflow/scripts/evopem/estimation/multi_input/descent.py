"""Descents of polynomial models with several inputs, in the way of their objective."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation import absolute_descent
from evopem.estimation.absolute_descent import SEARCH_WIDTH
from evopem.estimation.damped_descent import Optimum
from evopem.estimation.multi_input.errors import MultiInputErrors
from evopem.estimation.pem import levenberg_marquardt

Array = NDArray[np.float64]

# Tolerance of a descent of the search.
TOLERANCE = 1e-7


def descend(
    errors: MultiInputErrors, start: Array, max_iterations: int, tolerance: float
) -> Optimum:
    """Descend from a point, in the way of the objective.

    Parameters
    ----------
    errors : MultiInputErrors
    start : (n,) array
    max_iterations : int
        Of the quadratic objective.
    tolerance : float
        As of :func:`.levenberg_marquardt.descend`.  The absolute objective is smoothed until the
        end of a descent of a search, or to the last digits where the tolerance is below its own.
    """
    if errors.objective == "quadratic":
        return levenberg_marquardt.descend(errors, start, max_iterations, tolerance)
    if tolerance >= TOLERANCE:
        found = absolute_descent.descend(errors, start, SEARCH_WIDTH)
    else:
        found = absolute_descent.polish(errors, start)
    value = 100.0 * (float(np.exp(found.value)) - absolute_descent.ROUNDING)
    return Optimum(found.point, value, found.converged, found.evaluations)
