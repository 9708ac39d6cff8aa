"""What the residuals of a model say of the noise: heavy tails, and feedback to the input."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.fit import log_loss
from evopem.automatic.held_out.simulation import Model, prediction_errors
from evopem.signals.recording import Segment

Array = NDArray[np.float64]


def heaviness(model: Model, stretches: Sequence[Segment]) -> float:
    """How much likelier a residual is under Laplace's distribution than under a normal one.

    The mean logarithm of the ratio, each distribution at its likeliest scale.
    """
    e = np.concatenate([prediction_errors(model, each) for each in stretches])
    return 0.5 * (log_loss(e, "quadratic") - log_loss(e, "absolute"))


def feedback_probability(model: Model, stretches: Sequence[Segment]) -> float:
    """Probability that an input depends so much on past residuals by chance.

    Each input is regressed on its own past without and with past residuals (an F test; Granger
    1969), in the longest stretch; of several inputs the lowest one counts, times their number.
    """
    stretch = max(stretches, key=lambda each: each.samples)
    e = prediction_errors(model, stretch)
    inputs = stretch.inputs[stretch.samples - len(e) :]
    lowest = min(_of_input(u, e) for u in inputs.T)
    return min(1.0, lowest * inputs.shape[1])


def _of_input(u: Array, e: Array) -> float:
    from scipy.stats import f

    n, lags = len(e), min(10, len(e) // (15 * e.shape[1]))
    if lags < 1:
        return 1.0
    past_inputs = [np.ones(n - lags), *(u[lags - k : n - k] for k in range(1, lags + 1))]
    past_errors = [each[lags - k : n - k] for each in e.T for k in range(1, lags + 1)]
    target = u[lags:]
    without = _sum_of_squares(np.column_stack(past_inputs), target)
    with_residuals = _sum_of_squares(np.column_stack([*past_inputs, *past_errors]), target)
    added = len(past_errors)
    freedom = len(target) - lags - added - 1
    if not with_residuals > 0.0 or freedom < 1:
        return 1.0
    statistic = (without - with_residuals) / added / (with_residuals / freedom)
    return float(f.sf(statistic, added, freedom))


def _sum_of_squares(regressors: Array, target: Array) -> float:
    e = target - regressors @ np.linalg.lstsq(regressors, target, rcond=None)[0]
    return float(e @ e)
