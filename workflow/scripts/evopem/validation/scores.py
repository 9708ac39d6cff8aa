"""Two scores of a computed response against the measured one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike


def error_percent(measured: ArrayLike, computed: ArrayLike) -> float:
    """Relative error 100 ‖y − ŷ‖ / ‖y‖ in percent; ``nan`` when y is zero throughout."""
    y, y_hat = np.asarray(measured, dtype=float), np.asarray(computed, dtype=float)
    reference = float(np.linalg.norm(y))
    return 100.0 * float(np.linalg.norm(y - y_hat)) / reference if reference > 0 else math.nan


def fit_percent(measured: ArrayLike, computed: ArrayLike) -> float:
    """NRMSE fit 100 (1 − ‖y − ŷ‖ / ‖y − ȳ‖) in percent; ``nan`` when y is constant.

    100 is perfect, 0 is as good as the mean of y, negative is worse than it.
    """
    y, y_hat = np.asarray(measured, dtype=float), np.asarray(computed, dtype=float)
    reference = float(np.linalg.norm(y - y.mean()))
    if reference == 0:
        return math.nan
    return 100.0 * (1.0 - float(np.linalg.norm(y - y_hat)) / reference)


def outlier_percent(residuals: ArrayLike) -> float:
    """Percentage of residuals that lie beyond five robust standard deviations of their median.

    The robust standard deviation is 1.4826 times the median distance from the median; of normal
    residuals one in two million lies so far out.
    """
    e = np.asarray(residuals, dtype=float)
    distance = np.abs(e - np.median(e))
    return float(100.0 * np.mean(distance > 5.0 * 1.4826 * np.median(distance)))
