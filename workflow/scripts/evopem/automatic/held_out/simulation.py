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
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Segment

Array = NDArray[np.float64]

Model = PolynomialModel | StateSpaceModel

# A pole of a larger radius makes a simulation grow without bound.
STABLE = 1.0 + 1e-9


def in_state_space(model: Model) -> StateSpaceModel | None:
    """The model in state space where it has several channels; None for one input at most."""
    if isinstance(model, StateSpaceModel):
        return model
    return model.state_space() if model.inputs > 1 else None


def errors_simulated_on(
    model: Model,
    before: Segment,
    held_out: Segment,
    fitted_level: bool = False,
    robust: bool = False,
) -> Array:
    """Errors of a simulation of held-out samples whose outputs determine no state, (M, l).

    It runs on from the samples before, which determine its initial state; without any, the first
    tenth of the held-out samples do, and are not scored.  A state that were fitted to what is
    scored would draw slow waves through drifts with poles near the unit circle.  With
    ``fitted_level`` a constant is fitted to the scored errors; ``robust`` takes its median.
    """
    known = before.samples or first_samples(held_out.samples)
    inputs = np.concatenate([before.inputs, held_out.inputs])
    outputs = np.concatenate([before.outputs, held_out.outputs])
    states = in_state_space(model)
    with np.errstate(all="ignore"):
        if isinstance(model, PolynomialModel) and states is None:
            single = Segment(inputs, outputs)
            computed = simulate_from_first(
                model, single.input, single.output, known, fitted_level, robust
            )[:, None]
        else:
            assert states is not None
            computed = np.full(outputs.shape, np.inf)
            if np.abs(states.poles()).max(initial=0.0) < STABLE:
                computed = states.simulate_from_first(inputs, outputs, known, fitted_level, robust)
        errors = (computed - outputs)[known:]
        if fitted_level:
            centre = np.median if robust else np.mean
            errors = errors - centre(errors, axis=0)
    return np.asarray(errors)


def simulated(
    model: Model, stretch: Segment, fitted_level: bool = False, robust: bool = False
) -> Array:
    """Simulation from the initial state that fits the stretch, (N, l).

    With ``fitted_level`` the level is fitted to the stretch as well; ``robust`` takes the least
    absolute instead of the least squared errors, for one channel.
    """
    states = in_state_space(model)
    if isinstance(model, PolynomialModel) and states is None:
        return _simulated_polynomials(model, stretch, fitted_level, robust)[:, None]
    assert states is not None
    with np.errstate(all="ignore"):
        if np.abs(states.poles()).max(initial=0.0) >= STABLE:
            return np.full(stretch.outputs.shape, np.inf)
        return states.simulate_from_fitted_state(stretch.inputs, stretch.outputs, fitted_level)


def _simulated_polynomials(
    model: PolynomialModel, stretch: Segment, fitted_level: bool, robust: bool
) -> Array:
    """The level is filtered through 1/A from rest instead of being added as ``level / A(1)``.

    The initial state takes up the difference, and a pole at 1 makes no division by zero.
    """
    from scipy.signal import lfilter

    n = stretch.samples
    response = lfilter(model.delayed_b, model.plant_denominator, stretch.input)
    response = response + lfilter([model.level], model.a, np.ones(n))
    impulse = np.zeros(n)
    impulse[0] = 1.0
    decay = lfilter([1.0], model.plant_denominator, impulse)
    count = min(model.state_dimension, n - 1)
    columns = np.zeros((n, count + int(fitted_level)))
    for k in range(count):
        columns[k:, k] = decay[: n - k]
    columns[:, count:] = 1.0
    if not (np.isfinite(columns).all() and np.isfinite(response).all()):
        return np.full(n, np.inf)
    if columns.shape[1]:
        state = fitted_state(columns, stretch.output - response, robust)
        response = response + columns @ state
    return np.asarray(response)


def prediction_errors(model: Model, stretch: Segment) -> Array:
    """One-step prediction errors with fitted initial states, (M, l), of the last M samples."""
    states = in_state_space(model)
    if isinstance(model, PolynomialModel) and states is None:
        first = model.orders.first_residual
        if stretch.samples <= first + 1:
            return np.empty((0, 1))
        initial = estimate_prediction_states(model, stretch.input, stretch.output)
        return model.residuals(stretch.input, stretch.output, *initial)[first:, None]
    assert states is not None
    first = max(states.input_delays, default=0)
    if stretch.samples <= first + 1:
        return np.empty((0, states.outputs))
    with np.errstate(all="ignore"):
        state = states.prediction_state(stretch.inputs, stretch.outputs)
        return states.residuals(stretch.inputs, stretch.outputs, state)[first:]
