"""Errors of state-space models on samples, relative to the outputs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.settings import Objective
from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]

# Share of a record whose samples determine the state that its simulation begins with.
FIRST_SHARE = 0.1


def simulation_errors(
    model: StateSpaceModel, inputs: Array, outputs: Array, objective: Objective = "quadratic"
) -> Array:
    """``100 ||y - yhat|| / ||y - mean(y)||`` of each output, (ny,), initial state fitted.

    Infinite where the simulation is not finite.

    Parameters
    ----------
    model : StateSpaceModel
    inputs, outputs : (N, nu) and (N, ny) arrays
    objective : {"quadratic", "absolute"}
        As of :func:`continued_errors`.
    """
    with np.errstate(all="ignore"):
        if np.abs(model.poles()).max() >= 1.0 + 1e-9:
            return np.full(model.outputs, np.inf)
        state = model.simulation_state(inputs, outputs)
        errors = outputs - model.simulate(inputs, state)
    return _relative(errors, outputs, objective)


def continued_errors(
    model: StateSpaceModel,
    inputs: Array,
    outputs: Array,
    held_out: slice,
    objective: Objective = "quadratic",
) -> tuple[Array, Array]:
    """Errors of a simulation of held-out samples whose outputs determine no state.

    It runs on from the samples before, with the initial state that fits all samples but the
    held-out ones.  A state that were fitted to them would take up the noise that a lightly damped
    or slow mode of the model resembles.

    Parameters
    ----------
    model : StateSpaceModel
    inputs, outputs : (N, nu) and (N, ny) arrays
    held_out : slice
        Not from the first sample on.
    objective : {"quadratic", "absolute"}
        ``absolute``: mean absolute errors, which outliers among the held-out samples hardly change.

    Returns
    -------
    two (ny,) arrays
        As of :func:`simulation_errors`, with the level of the model, and with one that fits the
        held-out samples.
    """
    known = np.ones(len(outputs), dtype=bool)
    known[held_out] = False
    with np.errstate(all="ignore"):
        if np.abs(model.poles()).max() >= 1.0 + 1e-9:
            return np.full(model.outputs, np.inf), np.full(model.outputs, np.inf)
        state = model.simulation_state(inputs, outputs, known)
        errors = (outputs - model.simulate(inputs, state))[held_out]
    scored = outputs[held_out]
    level = np.median(errors, axis=0) if objective == "absolute" else errors.mean(axis=0)
    return _relative(errors, scored, objective), _relative(errors - level, scored, objective)


def errors_from_first_samples(
    model: StateSpaceModel, inputs: Array, outputs: Array, objective: Objective = "quadratic"
) -> tuple[Array, Array]:
    """Errors of a simulation of a record by itself, whose first samples alone determine a state.

    For the reason of :func:`continued_errors` the others determine none.  The first ones are not
    scored.

    Parameters as of :func:`continued_errors`.

    Returns
    -------
    two (ny,) arrays
        As of :func:`simulation_errors`, relative to all outputs, with the level of the model, and
        with one that fits.
    """
    infinite = np.full(model.outputs, np.inf)
    first = max(round(FIRST_SHARE * len(outputs)), 1)
    with np.errstate(all="ignore"):
        if np.abs(model.poles()).max() >= 1.0 + 1e-9:
            return infinite, infinite
        found = []
        for each in (model, model.levelled(inputs, outputs)[0]):
            errors = outputs - each.simulate(inputs, each.driven_state(inputs, outputs, first))
            errors[:first] = 0.0
            found.append(
                _relative(errors, outputs, objective) * _of_all(len(outputs), first, objective)
            )
    return found[0], found[1]


def _of_all(samples: int, first: int, objective: Objective) -> float:
    """The factor from errors of all samples but the first to errors of all."""
    share = samples / (samples - first)
    return share if objective == "absolute" else float(np.sqrt(share))


def prediction_errors(
    model: StateSpaceModel, inputs: Array, outputs: Array, objective: Objective = "quadratic"
) -> Array:
    """Errors of one-step predictions in percent, (ny,), initial state fitted.

    Parameters as of :func:`continued_errors`.
    """
    state = model.prediction_state(inputs, outputs)
    return _relative(model.residuals(inputs, outputs, state), outputs, objective)


def _relative(errors: Array, outputs: Array, objective: Objective = "quadratic") -> Array:
    """``100 ||e|| / ||y - mean(y)||``, or ``100 sum |e| / sum |y - median(y)|``, of each output."""
    if objective == "absolute":
        spread = np.sum(np.abs(outputs - np.median(outputs, axis=0)), axis=0)
        size = np.sum(np.abs(errors), axis=0)
    else:
        spread = np.linalg.norm(outputs - outputs.mean(axis=0), axis=0)
        size = np.linalg.norm(errors, axis=0)
    relative = 100.0 * size / np.where(spread > 0.0, spread, np.nan)
    return np.where(np.isfinite(relative), relative, np.inf)
