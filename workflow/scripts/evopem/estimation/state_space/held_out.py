"""Errors of state-space models on samples, relative to the outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.settings import Objective
from evopem.estimation.state_space.local_estimates import span_of
from evopem.estimation.state_space.point_model import model_of
from evopem.estimation.state_space.search import FINAL_WIDTH, swept
from evopem.estimation.state_space.task import StateSpaceTask
from evopem.models.polynomial_states import first_samples
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording

Array = NDArray[np.float64]


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
    """Errors of a simulation of a segment by itself, whose first samples alone determine a state.

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
    first = first_samples(len(outputs))
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


def simulated_on(
    model: StateSpaceModel, before: Recording | None, record: Recording, free_level: bool
) -> Array:
    """Response to the inputs from a state that the outputs of scored samples do not determine.

    Those that determine it are NaN.
    """
    u, y = record.inputs, record.outputs
    if before is None:
        known = first_samples(len(y))
        found = model.simulate(u, model.driven_state(u, y, known))
        found[:known] = np.nan
    else:
        state = model.simulation_state(before.inputs, before.outputs)
        found = model.simulate(np.concatenate([before.inputs, u]), state)[before.samples :]
    if free_level:
        found = found + np.nanmean(y - found, axis=0)
    return found


def simulated_from_fitted_state(
    model: StateSpaceModel, record: Recording, free_level: bool
) -> Array:
    """Response to the inputs of a record from the state that fits its outputs best."""
    u, y = record.inputs, record.outputs
    if free_level:
        model, state = model.levelled(u, y)
        return model.simulate(u, state)
    return model.simulate(u, model.simulation_state(u, y))


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


def two_fold_simulation_errors(
    recording: Recording, orders: Sequence[int], task: StateSpaceTask, width: int = FINAL_WIDTH
) -> Array:
    """Errors of models of each half on the other half, percent, (orders,).

    ``100 ||y - yhat|| / ||y - mean(y)||``, mean over outputs, of simulations from the initial state
    that fits; halves of the segments, where there are several.  Infinite where there is no model.
    """
    span = span_of(orders)
    squares = np.zeros((len(span), recording.outputs.shape[1]))
    reference = np.zeros(recording.outputs.shape[1])
    seen = np.zeros(len(span), dtype=int)
    halves = _halves(recording)
    for fold, (train, test) in enumerate((halves, halves[::-1])):
        powers = [np.sum((e.outputs - e.outputs.mean(axis=0)) ** 2, axis=0) for e in test.segments]
        reference += np.sum(powers, axis=0)
        with one_blas_thread():
            errors = task.errors(train, span[-1])
            for problem, result in swept(errors, span, task.settings, width, None, 1 + fold):
                model = model_of(problem.errors, problem.projection(result.point))
                at = span.index(model.order)
                seen[at] += 1
                for segment, power in zip(test.segments, powers, strict=True):
                    left = simulation_errors(model, segment.inputs, segment.outputs)
                    squares[at] += (left / 100.0) ** 2 * power
    relative = 100.0 * np.sqrt(squares / reference).mean(axis=1)
    return np.where(seen == 2, relative, np.inf)


def _halves(recording: Recording) -> tuple[Recording, Recording]:
    segments = recording.segments
    if len(segments) > 1:
        middle = len(segments) // 2
        parts = segments[:middle], segments[middle:]
        return recording.with_segments(parts[0]), recording.with_segments(parts[1])
    middle = recording.samples // 2
    return recording.between(0, middle), recording.between(middle, recording.samples)
