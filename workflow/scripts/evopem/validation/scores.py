"""Scores of computed responses and of residuals."""

import math

import numpy as np
from numpy.typing import ArrayLike

from evopem.arrays import Array


def error_percent(measured: ArrayLike, computed: ArrayLike) -> float:
    """Relative error ``100 ||y - yhat|| / ||y - mean(y)||`` in percent; NaN when y is constant.

    0 is perfect, 100 is as good as the mean of y, more is worse than it.
    """
    y, y_hat = np.asarray(measured, dtype=float), np.asarray(computed, dtype=float)
    reference = _norm(y - y.mean())
    return 100.0 * _norm(y - y_hat) / reference if reference > 0 else math.nan


def outlier_percent(residuals: ArrayLike) -> float:
    """Percentage of residuals beyond five robust standard deviations of their median.

    Of normal residuals one in two million lies so far out.
    """
    e = np.asarray(residuals, dtype=float)
    distance = np.abs(e - np.median(e))
    return float(100.0 * np.mean(distance > 5.0 * 1.4826 * np.median(distance)))


def _norm(values: Array) -> float:
    """Euclidean norm, also of numbers whose squares leave the range of floats.

    An unstable response that is transformed back to recorded units may reach these.
    """
    _, exponent = np.frexp(np.max(np.abs(values), initial=0.0))
    scaled = np.linalg.norm(np.ldexp(values, -exponent))  # a power of two keeps every bit
    return float(np.ldexp(scaled, exponent))
