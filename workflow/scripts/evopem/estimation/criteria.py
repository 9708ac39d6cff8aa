"""Criteria of an estimate, and what all estimates share: scales of signals, stability bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A root this close to the largest allowed radius, relative to the distance of that radius from the
# unit circle, counts as lying at the stability bound.
BOUND_WIDTH = 0.05


@dataclass(frozen=True)
class Criteria:
    """Criteria of an estimate over the samples of its loss.

    ``objective``: percent (chapter eq. 20 or 22).  ``fit_percent``: one-step NRMSE fit
    ``100 (1 - ||e|| / ||y - mean(y)||)``, as MATLAB's ``compare`` has it. The chapter's fit (eq.
    21) is 100 minus the absolute objective.  ``rss``: ``100 ||e||^2 / ||y||^2`` in percent (chapter
    eq. 22).  ``bic``: ``ln(||e||^2 / N) + n ln(N) / N`` (chapter eq. 23).
    """

    objective: float
    fit_percent: float
    rss: float
    bic: float


def criteria_of(residuals: Array, output: Array, objective: str, parameters: int) -> Criteria:
    """Criteria of residuals, (N,), and of the output of the same samples.

    ``residuals``, ``output`` (N,): the samples of the loss.  ``parameters``: number of estimated
    parameters n.
    """
    square_sum, count = float(residuals @ residuals), len(residuals)
    rss = 100.0 * square_sum / float(output @ output)
    absolute = 100.0 * float(np.sum(np.abs(residuals)) / np.sum(np.abs(output)))
    deviation = float(np.linalg.norm(output - output.mean()))
    return Criteria(
        objective=rss if objective == "quadratic" else absolute,
        fit_percent=100.0 * (1.0 - np.sqrt(square_sum) / deviation),
        rss=rss,
        bic=float(np.log(square_sum / count) + parameters * np.log(count) / count),
    )


def power_of_two_scale(signal: Array) -> float:
    """The power of two next below a signal's largest magnitude; 1 for a signal of zeros.

    Dividing by it leaves every bit of a signal's mantissa unchanged.
    """
    largest = float(np.max(np.abs(signal)))
    return 2.0 ** np.floor(np.log2(largest)) if largest > 0.0 else 1.0


def lies_at_bound(radius: float, bound: float) -> bool:
    """Whether a root of some radius lies at the largest radius allowed."""
    return bool(1.0 - radius <= (1.0 + BOUND_WIDTH) * (1.0 - bound))
