"""Losses of residuals: magnitudes of the absolute objective, squares of the quadratic one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def total_loss(signal: Array, objective: str) -> float:
    """Sum of the losses of a signal, (N,)."""
    return float(np.sum(np.abs(signal)) if objective == "absolute" else signal @ signal)


def mean_residuals(values: Array, total: float, samples: int, objective: str) -> Array:
    """Mean, or of the quadratic objective root mean square, residual of values in percent, (M,).

    ``values`` (M,): ``100 sum loss(e) / total``.  ``total``: of the outputs, as :func:`total_loss`
    gives it.  ``samples``: residuals that count.
    """
    mean = values / 100.0 * total / samples
    return mean if objective == "absolute" else np.sqrt(mean)


def slopes_of(residuals: Array, objective: str, first: int) -> Array:
    """Half the slopes of squares, or those of magnitudes; 0 before the first residual counted."""
    slopes = np.sign(residuals) if objective == "absolute" else residuals.copy()
    slopes[:first] = 0.0
    return slopes
