"""Tests of the residuals of a model on several stretches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.fit import log_loss
from evopem.automatic.simulation import prediction_errors
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Segment

Array = NDArray[np.float64]


def heaviness(model: PolynomialModel, stretches: Sequence[Segment]) -> float:
    """How much likelier a residual is under Laplace's distribution than under a normal one.

    The mean logarithm of the ratio, each distribution at its likeliest scale.
    """
    e = _residuals(model, stretches)
    return 0.5 * (log_loss(e, "quadratic") - log_loss(e, "absolute"))


def feedback_probability(model: PolynomialModel, stretches: Sequence[Segment]) -> float:
    """Probability that the input depends so much on past residuals by chance.

    The input is regressed on its own past without and with past residuals (an F test; Granger
    1969), in the longest stretch.
    """
    from scipy.stats import f

    stretch = max(stretches, key=lambda each: each.samples)
    e = prediction_errors(model, stretch)
    u = stretch.input[len(stretch.input) - len(e) :]
    n, lags = len(e), min(10, len(e) // 15)
    if lags < 1:
        return 1.0
    own = [np.ones(n - lags), *(u[lags - k : n - k] for k in range(1, lags + 1))]
    other = [e[lags - k : n - k] for k in range(1, lags + 1)]
    target = u[lags:]
    without = _sum_of_squares(np.column_stack(own), target)
    with_residuals = _sum_of_squares(np.column_stack([*own, *other]), target)
    freedom = len(target) - 2 * lags - 1
    if not with_residuals > 0.0 or freedom < 1:
        return 1.0
    statistic = (without - with_residuals) / lags / (with_residuals / freedom)
    return float(f.sf(statistic, lags, freedom))


def _residuals(model: PolynomialModel, stretches: Sequence[Segment]) -> Array:
    return np.concatenate([prediction_errors(model, each) for each in stretches])


def _sum_of_squares(regressors: Array, target: Array) -> float:
    e = target - regressors @ np.linalg.lstsq(regressors, target, rcond=None)[0]
    return float(e @ e)
