"""Likelihood of errors of several outputs, of both objectives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.settings import Objective

Array = NDArray[np.float64]


def log_loss(errors: Array, objective: Objective) -> float:
    """Minus twice the largest log-likelihood of a sample of errors, but for a constant.

    Of normal errors, correlated between the outputs, for the quadratic objective, and of
    independent ones with Laplace's distribution for the absolute one.

    Parameters
    ----------
    errors : (N, ny) array
    objective : {"quadratic", "absolute"}
    """
    if objective == "absolute":
        with np.errstate(divide="ignore"):
            return 2.0 * float(np.sum(np.log(np.mean(np.abs(errors), axis=0))))
    sign, log_determinant = np.linalg.slogdet(errors.T @ errors / len(errors))
    return float(log_determinant) if sign > 0 else -np.inf
