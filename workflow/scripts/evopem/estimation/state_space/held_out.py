"""Errors of state-space models on samples, relative to the outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.blas_threads import one_blas_thread
from evopem.estimation.state_space.local_estimates import span_of
from evopem.estimation.state_space.point_model import model_of
from evopem.estimation.state_space.search import FINAL_WIDTH, swept
from evopem.estimation.state_space.task import StateSpaceTask
from evopem.models.polynomial_states import first_samples
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording

Array = NDArray[np.float64]


def errors_simulated_on(
    model: StateSpaceModel,
    inputs: Array,
    outputs: Array,
    known: int,
    free_level: bool = False,
    objective: str = "quadratic",
) -> Array:
    """Errors, (N - known, l), of a simulation behind the samples that determine its state.

    A state that were fitted to what is scored would take up the noise that a lightly damped or slow
    mode resembles.  With a free level a constant is fitted to the errors: by their mean, or for the
    absolute objective, which outliers hardly change, by their median.
    """
    if np.abs(model.poles()).max() >= 1.0 + 1e-9:
        return np.full(outputs[known:].shape, np.inf)
    robust = objective == "absolute"
    simulated = model.simulate_from_first(inputs, outputs, known, free_level, robust)
    with np.errstate(all="ignore"):
        errors = (outputs - simulated)[known:]
        centre = np.median(errors, axis=0) if robust else errors.mean(axis=0)
        return np.asarray(errors - centre if free_level else errors)


def simulated_on(
    model: StateSpaceModel, before: Recording | None, record: Recording, free_level: bool
) -> Array:
    """Response to the inputs of a record, (N, l), from a state that no scored sample determines.

    Those that determine it are NaN.
    """
    u, y = record.inputs, record.outputs
    known = before.samples if before else first_samples(len(y))
    if before is not None:
        u, y = np.concatenate([before.inputs, u]), np.concatenate([before.outputs, y])
    found = model.simulate_from_first(u, y, known, free_level)
    found[:known] = np.nan
    if free_level:
        found = found + np.nanmean(y - found, axis=0)
    return np.asarray(found[-record.samples :])


def simulated_from_fitted_state(
    model: StateSpaceModel, record: Recording, free_level: bool
) -> Array:
    """Response to the inputs of a record from the state that fits its outputs best."""
    return model.simulate_from_fitted_state(record.inputs, record.outputs, free_level)


def simulation_errors(
    model: StateSpaceModel, inputs: Array, outputs: Array, objective: str = "quadratic"
) -> Array:
    """:func:`relative_errors` of a simulation, initial state fitted, (l,)."""
    with np.errstate(all="ignore"):
        if np.abs(model.poles()).max() >= 1.0 + 1e-9:
            return np.full(model.outputs, np.inf)
        errors = outputs - model.simulate_from_fitted_state(inputs, outputs)
    return relative_errors(errors, outputs, objective)


def prediction_errors(
    model: StateSpaceModel, inputs: Array, outputs: Array, objective: str = "quadratic"
) -> Array:
    """:func:`relative_errors` of one-step predictions, initial state fitted, (l,)."""
    state = model.prediction_state(inputs, outputs)
    return relative_errors(model.residuals(inputs, outputs, state), outputs, objective)


def relative_errors(errors: Array, outputs: Array, objective: str = "quadratic") -> Array:
    """``100 ||e|| / ||y - mean(y)||``, or ``100 sum |e| / sum |y - median(y)|``, of each output.

    Infinite where errors are not finite.
    """
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
