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
    """Criteria of an estimate over the samples of its loss (chapter eq. 20 to 23).

    The chapter's fit (eq. 21) is 100 minus the absolute objective.
    """

    objective: float
    fit_percent: float
    rss: float
    bic: float


def criteria_of(residuals: Array, output: Array, objective: str, parameters: int) -> Criteria:
    """Criteria of residuals, (N,), the outputs of the same samples, and estimated parameters."""
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
    """The power of two next below a signal's largest magnitude, which changes no mantissa; or 1."""
    largest = float(np.max(np.abs(signal)))
    return 2.0 ** np.floor(np.log2(largest)) if largest > 0.0 else 1.0


def lies_at_bound(radius: float, bound: float) -> bool:
    """Whether a root of some radius lies at the largest radius allowed."""
    return bool(1.0 - radius <= (1.0 + BOUND_WIDTH) * (1.0 - bound))
