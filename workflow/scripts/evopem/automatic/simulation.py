"""Simulation and prediction of stretches, from the initial state that fits what is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_states import (
    estimate_prediction_states,
    first_samples,
    fitted_state,
    simulate_from_first,
)
from evopem.signals.recording import Segment

Array = NDArray[np.float64]


def errors_simulated_on(
    model: PolynomialModel,
    before: Segment,
    held_out: Segment,
    free_level: bool = False,
    robust: bool = False,
) -> Array:
    """Errors of a simulation of held-out samples whose outputs determine no state.

    It runs on from the samples before, which determine its initial state; without any, the first
    tenth of the held-out samples do, and are not scored.  A state that were fitted to what is
    scored would draw slow waves through drifts with poles near the unit circle.

    Parameters
    ----------
    model : PolynomialModel
    before, held_out : Segment
        Consecutive samples.
    free_level : bool
        Whether a constant is fitted to the scored errors.
    robust : bool
        As of :func:`simulated`.

    Returns
    -------
    (M,) array
        Simulated less measured output of the scored samples.
    """
    known = before.samples or first_samples(held_out.samples)
    whole = Segment(
        np.concatenate([before.inputs, held_out.inputs]),
        np.concatenate([before.outputs, held_out.outputs]),
        held_out.recording,
    )
    computed = simulate_from_first(model, whole.input, whole.output, known, free_level, robust)
    with np.errstate(all="ignore"):
        errors = (computed - whole.output)[known:]
        if free_level:
            errors = errors - (np.median(errors) if robust else np.mean(errors))
    return np.asarray(errors)


def simulated(
    model: PolynomialModel,
    stretch: Segment,
    free_level: bool = False,
    robust: bool = False,
) -> Array:
    """Simulation from the initial state that fits the stretch, (N,).

    The level is filtered through 1/A from rest instead of being added as ``level / A(1)``: the
    initial state takes up the difference, and a pole at 1 makes no division by zero.

    Parameters
    ----------
    model : PolynomialModel
    stretch : Segment
    free_level : bool
        Whether the level belongs to the state and is fitted to the stretch as well.
    robust : bool
        Whether the state has the least absolute instead of the least squared errors.
    """
    from scipy.signal import lfilter

    n = stretch.samples
    response = lfilter(model.delayed_b, model.plant_denominator, stretch.input)
    response = response + lfilter([model.level], model.a, np.ones(n))
    impulse = np.zeros(n)
    impulse[0] = 1.0
    decay = lfilter([1.0], model.plant_denominator, impulse)
    count = min(model.state_dimension, n - 1)
    columns = np.zeros((n, count + int(free_level)))
    for k in range(count):
        columns[k:, k] = decay[: n - k]
    columns[:, count:] = 1.0
    if not (np.isfinite(columns).all() and np.isfinite(response).all()):
        return np.full(n, np.inf)
    if columns.shape[1]:
        state = fitted_state(columns, stretch.output - response, robust)
        response = response + columns @ state
    return np.asarray(response)


def prediction_errors(model: PolynomialModel, stretch: Segment) -> Array:
    """One-step prediction errors with fitted initial states, from the first residual on."""
    if stretch.samples <= model.orders.first_residual + 1:
        return np.empty(0)
    states = estimate_prediction_states(model, stretch.input, stretch.output)
    errors = model.residuals(stretch.input, stretch.output, *states)
    return errors[model.orders.first_residual :]
