"""Estimate state-space models of one order or of several."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np

from evopem.arrays import Array, one_blas_thread
from evopem.config.constraints import (
    Constraints,
    gains_of_other_inputs,
    of_coefficients_in_state_space,
)
from evopem.config.settings import OutputWeighting, SearchSettings
from evopem.config.structures import check_model, samples_ahead
from evopem.errors import InputError, LostModelError, NoModelError
from evopem.estimation.criteria import log_loss
from evopem.estimation.pem.constrained_model import equalities
from evopem.estimation.polynomial_estimate import ConstraintEffect
from evopem.estimation.search.problem import Log, SearchResult, count_distinct
from evopem.estimation.state_space.entry_problem import EntryProblem
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.local_estimates import (
    QUADRATIC,
    StateSpaceEstimate,
    StateSpaceTask,
    best_descent,
    descend_from,
    described,
    plain_estimates,
)
from evopem.estimation.state_space.point_model import Matrices, PointModel
from evopem.estimation.state_space.pole_coordinates import poles_of
from evopem.estimation.state_space.problem import POLISH_STEPS, POLISH_TOLERANCE, STEPS
from evopem.estimation.state_space.search import FINAL_WIDTH, NO_MODELS, problem_for, searched
from evopem.estimation.state_space.starting_points import from_poles, point_of_model
from evopem.models.constraint_checks import check_constraints, refuse
from evopem.models.conversions import side_by_side
from evopem.models.orders import Orders
from evopem.models.state_space import StateSpaceModel, StateSpaceStructure
from evopem.signals.recording import Recording, Segment

# A search ends after so many orders of higher BIC; estimates of an order that are descended from;
# states of a noise model below those of the likeliest estimate by linear algebra.
RISES, WIDTH, BELOW = 2, 3, 3
MOST_STATES, VALUES_PER_PARAMETER = 10, 5  # largest order, and output values for each parameter
LONG = 40_000  # values of all channels from which on orders are tried in steps of two
# Weighting of the plants that structure ss_bj begins with.
PLANT_WEIGHTING: OutputWeighting = "noise"
RANDOM_STARTS = 8  # models of random allowed poles that are descended from
CONSTRAINED = 1  # last number of the key of their draws
# Shares of a noise model's gain that descents begin with: less draws its zeros in from the bound,
# beyond which a start may be unstable; and noise models that they begin with.
GAIN_SHARES, NOISES = (1.0, 0.8), 2
SAME = 1e-9  # relative distance of two objectives that is rounding


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
    task = StateSpaceTask.of(recording, structure, delays, forgets=forgets, **options)
    horizon = samples_ahead(focus)  # None for simulation
    check_model(structure, False, focus, constraints)
    if structure in ("ss_oe", "ss_oe_drift"):
        horizon = 1
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
        estimate = meeting(free, errors, horizon or 1, constraints, task.settings)
    return replace(estimate, focus=focus)


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
        points = [point_of_model(start, errors) for start in starts]
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
    of_plant = replace(task, structure="ss_oe", weighting=weighting)
    plant = _searched(recording, order, of_plant, (), log)
    if horizon is None:
        model = with_noise_model(plant.model, recording, task.settings)
        return replace(plant, model=model, focus_objective=plant.objective)
    optima = []
    for start in starts:
        with suppress(LostModelError):
            optima.append(descend_from(start, recording, task))
    optima.append(estimate_beside(plant.model, recording, task, POLISH_STEPS))
    return replace(min(optima, key=lambda estimate: estimate.bic), order=order)


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
    starts: Mapping[int, StateSpaceModel] = NO_MODELS,
    covariances: bool = True,
    log: Log | None = None,
) -> Iterator[StateSpaceEstimate]:
    """Cheap estimates of several orders, each from estimates and from its neighbours.

    One after the other as they are needed.  Parameters as of :func:`estimate_state_space`.

    Parameters
    ----------
    orders : sequence of int
        Ascending.
    width : int
        Estimates of each order that are descended from.
    steps : int
        Of each descent at most: too small orders, which do not describe the recording, converge
        slowly, and nothing depends on their last digits.
    starts : mapping
        Models of any form by their order, which are descended from as well.
    covariances : bool
        Whether models have them: with many channels they take as long as the rest.
    """
    options = {"level": level, "weighting": weighting, "settings": settings or QUADRATIC}
    options |= {"forgets": forgets, "covariances": covariances}
    task = StateSpaceTask.of(recording, structure, delays, **options)
    if structure != "ss_bj":
        yield from plain_estimates(recording, orders, task, width, steps, starts, log)
        return
    plants = replace(task, structure="ss_oe", weighting=PLANT_WEIGHTING, covariances=False)
    given = recording, orders, plants, min(width, WIDTH), steps, starts, log
    for plant in plain_estimates(*given):
        with suppress(NoModelError, np.linalg.LinAlgError):
            yield replace(estimate_beside(plant.model, recording, task, steps), order=plant.order)


def noise_orders(recording: Recording) -> tuple[int, ...]:
    """The orders that are tried for the noise model of a recording."""
    samples, of_order = recording.samples, 1 + len(recording.segment_starts)
    affordable = min(MOST_STATES, samples // 12, samples // VALUES_PER_PARAMETER // of_order)
    step = 2 if recording.inputs.size + recording.outputs.size > LONG else 1
    return tuple(range(step, max(affordable, step) + 1, step))


def noise_models(
    plant: StateSpaceModel, recording: Recording, settings: SearchSettings, covariances: bool = True
) -> list[StateSpaceModel | None]:
    """Noise models for the residuals of a plant, the lowest BIC first; None for white ones."""
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
    models: list[StateSpaceModel | None] = [None]
    criteria, rises = [log_loss(joined, settings.objective)], 0
    task = StateSpaceTask(settings=settings, covariances=covariances)
    for estimate in plain_estimates(alone, noise_orders(recording), task, WIDTH, below=BELOW):
        rises = 0 if estimate.bic < min(criteria) else rises + 1
        models.append(estimate.model)
        criteria.append(estimate.bic)
        if rises >= RISES:
            break
    return [models[place] for place in np.argsort(criteria, kind="stable")]


def with_noise_model(
    plant: StateSpaceModel, recording: Recording, settings: SearchSettings
) -> StateSpaceModel:
    """An output-error plant with its noise model; alone where its residuals are white."""
    return _beside_noise(plant, noise_models(plant, recording, settings)[0])


def _beside_noise(plant: StateSpaceModel, noise: StateSpaceModel | None) -> StateSpaceModel:
    return plant if noise is None else side_by_side(plant, noise)


def estimate_beside(
    plant: StateSpaceModel, recording: Recording, task: StateSpaceTask, steps: int
) -> StateSpaceEstimate:
    """The optimum of innovations form next to an output-error plant with its noise model.

    The best from the likeliest ones, with all of their gain and with less, else from the plant
    alone; see :func:`.best_descent`.
    """
    noises = noise_models(plant, recording, task.settings, covariances=False)[:NOISES]
    pairs = [*product(noises, GAIN_SHARES), (None, 0.0)]
    models = [(_beside_noise(plant, noise), share) for noise, share in pairs]
    starts = [replace(m, K=share * m.K, structure="ss", covariance=None) for m, share in models]
    return best_descent(starts, recording, task, steps)


def check_state_space_constraints(constraints: Constraints, errors: StateSpaceErrors) -> None:
    """InputError for constraints that no state-space model can meet, or of unclear meaning."""
    recording = errors.data.recording
    names = recording.input_names or ("",)
    refuse(of_coefficients_in_state_space(constraints))
    refuse(gains_of_other_inputs(constraints, names))
    inputs, n = recording.inputs.shape[1], errors.order
    na, nf = (n, 0) if errors.innovations else (0, n)
    for name in names:
        of_input = constraints.of_input(name)
        keys = ("static_gain", "static_gain_bounds")
        key = next((key for key in keys if getattr(of_input, key) is not None), "")
        named = inputs < 2 or isinstance(getattr(constraints, key, None), dict)
        if key and not (named and recording.outputs.shape[1] == 1):
            raise InputError(
                "constraints",
                "a model with several channels has a static gain for each input and output, and"
                " it is not said which one is meant",
                "name the input, and estimate one output alone",
                key,
            )
        nb = n if inputs or not key else 0
        orders = Orders(nb=nb, na=na, nc=na, nf=nf, nk=min(nb, 1))
        check_constraints(of_input, orders, recording.sampling_rate)


def meeting(
    free: StateSpaceEstimate,
    errors: StateSpaceErrors,
    horizon: int,
    constraints: Constraints | None,
    settings: SearchSettings,
) -> StateSpaceEstimate:
    """The estimate for errors so many samples ahead that meets constraints, which are checked.

    ``free``: that of one step without constraints.  NoModelError without a model of finite errors.
    """
    problem = EntryProblem(errors, horizon, constraints, settings.objective)
    projection = problem_for(errors, settings).projection(free.search.point)
    point = problem.begun(problem.point_of(PointModel(errors, projection).matrices))
    begun = problem.percent(problem.projection(point).errors)
    if horizon == 1 and abs(begun - free.objective) <= SAME * free.objective:
        names, _ = problem.active(point)
        return replace(free, constraints=_effect(constraints, begun, free.objective, names))
    begins = [point]
    if constraints is not None and errors.data.inputs.shape[1]:
        begins += [problem.begun(allowed) for allowed in _allowed(problem, point, settings)]
    optima = [optimum for optimum in map(problem.optimum, begins) if np.isfinite(optimum.value)]
    if not optima:
        raise NoModelError("no model that meets the constraints has finite errors")
    lowest = min(optima, key=lambda optimum: optimum.value)
    best = problem.optimum(lowest.point, POLISH_STEPS, POLISH_TOLERANCE)
    *values, value = (
        problem.percent(problem.projection(optimum.point).errors) for optimum in (*optima, best)
    )
    spent = sum(optimum.evaluations for optimum in (*optima, best))
    spent += free.search.diagnostics.evaluations
    given = best.point, value, spent, count_distinct(values), values
    made = described(problem, SearchResult.of_descents(*given))
    names, _ = problem.active(best.point)
    return replace(
        made,
        order=free.order,
        objective=problem.percent(problem.projection(best.point).one_step),
        focus_objective=value,
        constraints=_effect(constraints, value, free.objective, names),
    )


def _allowed(problem: EntryProblem, point: Array, settings: SearchSettings) -> Iterator[Array]:
    """Points of allowed poles, those of a point and random ones, whose inputs fit."""
    errors, m = problem.plain, problem.plain.data.inputs.shape[1]
    plant = replace(errors, structure="ss_oe")
    key = (errors.order, int(errors.innovations), CONSTRAINED)
    generator = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))
    allowed = [[point[at] for at in problem.columns]]
    allowed += [[block.random(generator) for block in problem.blocks] for _ in range(RANDOM_STARTS)]
    for coordinates in allowed:
        pairs = zip(problem.blocks, coordinates, strict=True)
        poles = np.concatenate([poles_of(b.values(z)[0])[: b.states] for b, z in pairs])
        projection = plant.projection(from_poles(plant, poles))
        if np.isfinite(projection.linear).all():
            A, drives, outputs = PointModel(plant, projection).matrices
            gain = np.zeros((errors.order, errors.signals.driving - m))
            drives = np.hstack([drives[:, :m], gain, drives[:, m:]])
            yield problem.point_of(Matrices(A, drives, outputs))


def _effect(
    constraints: Constraints | None, value: float, without: float, active: Sequence[str]
) -> ConstraintEffect | None:
    if constraints is None:
        return None
    return ConstraintEffect(value, without, (*equalities(constraints), *active))
