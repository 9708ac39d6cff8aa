"""Estimate state-space models of one order or of several."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import OutputWeighting, SearchSettings
from evopem.config.structures import check_model, samples_ahead
from evopem.estimation.criteria import log_loss
from evopem.estimation.state_space.entry_estimate import check_state_space_constraints, meeting
from evopem.estimation.state_space.local_estimates import (
    QUADRATIC,
    StateSpaceEstimate,
    StateSpaceTask,
    descend_from,
    described,
    plain_estimates,
)
from evopem.estimation.state_space.problem import STEPS
from evopem.estimation.state_space.search import FINAL_WIDTH, searched
from evopem.estimation.state_space.starting_points import point_of_model
from evopem.models.conversions import side_by_side
from evopem.models.state_space import StateSpaceModel, StateSpaceStructure
from evopem.signals.recording import Recording, Segment

Array = NDArray[np.float64]
Log = Callable[[str], None]


# A search of orders ends after so many of higher BIC; estimates of each order that are descended
# from.
RISES, WIDTH = 2, 3
# Largest order, and output values for each parameter.
MOST_STATES, VALUES_PER_PARAMETER = 10, 5
# Values of all channels from which on orders are tried in steps of two.
LONG = 40_000
# Weighting of the plants that structure ss_bj begins with.
PLANT_WEIGHTING: OutputWeighting = "noise"


def estimate_state_space(
    recording: Recording,
    order: int,
    *,
    structure: StateSpaceStructure = "ss",
    delays: int | Sequence[int] = 1,
    level: bool = True,
    focus: str | int = "prediction",
    constraints: Constraints | None = None,
    weighting: OutputWeighting = "determinant",
    settings: SearchSettings | None = None,
    forgets: bool = False,
    starts: Sequence[StateSpaceModel] = (),
    log: Log | None = None,
) -> StateSpaceEstimate:
    """The state-space model of an order with the smallest prediction errors; see :func:`.estimate`.

    ``order``: states n; of structure ``ss_bj``, an optimum of innovations form next to an
    output-error plant of n states with a noise model of its own, those of the plant.  ``starts``:
    models of this order, structure and delays to descend from as well; a very large problem has no
    others then.  The settings limit the evaluations, whose number follows from the size of the
    problem, or raise it above their default; 0 is descents from estimates alone.  Draws come from
    ``SeedSequence(seed, spawn_key=(order, structure, level, *delays))``.  InputError when focus,
    constraints and structure contradict each other; ValueError when the recording is too short, or
    a setting outside its range.
    """
    options = {"level": level, "weighting": weighting, "settings": settings or QUADRATIC}
    task = StateSpaceTask.of(recording, structure, delays, forgets, **options)
    horizon = _horizon(focus, structure, constraints)
    if structure == "ss_bj":
        free = _beside(recording, order, task, horizon, starts, log)
    else:
        if constraints is not None:
            check_state_space_constraints(constraints, task.errors(recording, order))
        free = _searched(recording, order, task, starts, log)
    if constraints is None and horizon in (1, None):
        return replace(free, focus=focus)
    with one_blas_thread():
        errors = replace(task, structure=free.model.structure).errors(recording, free.model.order)
        found = meeting(free, errors, horizon or 1, constraints, task.settings)
    return replace(found, focus=focus)


def _searched(
    recording: Recording,
    order: int,
    task: StateSpaceTask,
    starts: Sequence[StateSpaceModel],
    log: Log | None,
) -> StateSpaceEstimate:
    """With K or without, of one step and without constraints."""
    with one_blas_thread():
        errors = task.errors(recording, order)
        points = [point_of_model(each, errors) for each in starts]
        return described(*searched(errors, points, task.settings, log))


def _beside(
    recording: Recording,
    order: int,
    task: StateSpaceTask,
    horizon: int | None,
    starts: Sequence[StateSpaceModel],
    log: Log | None,
) -> StateSpaceEstimate:
    """Structure ``ss_bj``; for simulation, without a horizon, the plant beside its noise model."""
    weighting = task.weighting if horizon is None else PLANT_WEIGHTING
    own = replace(task, structure="ss_oe", weighting=weighting)
    plant = _searched(recording, order, own, (), log)
    if horizon is None:
        model = with_noise_model(plant.model, recording, task.settings)
        return replace(plant, model=model, focus_objective=plant.objective)
    optima = [descend_from(start, recording, task) for start in starts]
    optima.append(estimate_beside(plant.model, recording, task))
    return replace(min(optima, key=lambda estimate: estimate.bic), order=order)


def _horizon(
    focus: str | int,
    structure: StateSpaceStructure,
    constraints: Constraints | None,
) -> int | None:
    """Samples ahead; None for simulation where that differs from prediction."""
    ahead = samples_ahead(focus)
    check_model(structure, False, focus, constraints)
    return 1 if structure in ("ss_oe", "ss_oe_drift") else ahead


def estimates_of_orders(
    recording: Recording,
    orders: Sequence[int],
    *,
    structure: StateSpaceStructure = "ss",
    delays: int | Sequence[int] = 1,
    level: bool = True,
    weighting: OutputWeighting = "determinant",
    settings: SearchSettings | None = None,
    forgets: bool = False,
    width: int = FINAL_WIDTH,
    steps: int = STEPS,
    log: Log | None = None,
) -> Iterator[StateSpaceEstimate]:
    """Cheap estimates of several orders, each from estimates and from its neighbours.

    One after the other as they are needed.  Parameters as of :func:`estimate_state_space`.

    Parameters
    ----------
    orders : sequence of int
        Ascending, one after the other or every other one.
    width : int
        Estimates of each order that are descended from.
    steps : int
        Of each descent at most: too small orders, which do not describe the recording, converge
        slowly, and nothing depends on their last digits.
    """
    options = {"level": level, "weighting": weighting, "settings": settings or QUADRATIC}
    task = StateSpaceTask.of(recording, structure, delays, forgets, **options)
    if structure != "ss_bj":
        yield from plain_estimates(recording, orders, task, width, steps, log)
        return
    plants = replace(task, structure="ss_oe", weighting=PLANT_WEIGHTING)
    for plant in plain_estimates(recording, orders, plants, min(width, WIDTH), steps, log):
        try:
            estimate = estimate_beside(plant.model, recording, task)
        except ValueError:
            continue
        yield replace(estimate, order=plant.order)


def noise_orders(recording: Recording) -> tuple[int, ...]:
    """The orders that are tried for the noise model of a recording."""
    samples, of_order = recording.samples, 1 + len(recording.segment_starts)
    affordable = min(MOST_STATES, samples // 12, samples // VALUES_PER_PARAMETER // of_order)
    if recording.inputs.size + recording.outputs.size > LONG:
        return tuple(range(2, max(affordable, 2) + 1, 2))
    return tuple(range(1, max(affordable, 1) + 1))


def noise_model(
    plant: StateSpaceModel,
    recording: Recording,
    settings: SearchSettings,
    orders: Sequence[int] | None = None,
) -> StateSpaceModel | None:
    """The noise model of lowest BIC for the residuals of a plant; None where they are white."""
    lost = max(plant.input_delays, default=0)
    residuals = []
    for segment in recording.segments:
        u, y = segment.inputs, segment.outputs
        left = (y - plant.simulate_from_fitted_state(u, y))[lost:]
        residuals.append(left - left.mean(axis=0))
    joined = np.vstack(residuals)
    alone = replace(
        recording, inputs=recording.inputs[:, :0], input_names=(), input_units=()
    ).with_segments([Segment(e[:, :0], e, number) for number, e in enumerate(residuals)])
    lowest, best = log_loss(joined, settings.objective), None
    rises = 0
    orders = noise_orders(recording) if orders is None else orders
    for estimate in plain_estimates(alone, orders, StateSpaceTask(settings=settings), WIDTH):
        rises += 1
        if estimate.bic < lowest:
            lowest, best, rises = estimate.bic, estimate.model, 0
        if rises >= RISES:
            break
    return best


def with_noise_model(
    plant: StateSpaceModel, recording: Recording, settings: SearchSettings
) -> StateSpaceModel:
    """An output-error plant with its noise model; alone where its residuals are white."""
    noise = noise_model(plant, recording, settings)
    return plant if noise is None else side_by_side(plant, noise)


def estimate_beside(
    plant: StateSpaceModel, recording: Recording, task: StateSpaceTask
) -> StateSpaceEstimate:
    """The optimum of innovations form next to an output-error plant with its noise model.

    ValueError when the recording is too short, or the descent ends at no stable model.
    """
    start = with_noise_model(plant, recording, task.settings)
    start = replace(start, structure="ss", covariance=None)
    return descend_from(start, recording, task)
