"""State-space models for errors of several steps, and those that meet hard constraints.

They are descended to from the optimum of one step without constraints, and under constraints also
from models of allowed poles whose inputs fit the recording, those of the optimum and random ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.constraints import Constraints
from evopem.config.settings import SearchSettings
from evopem.errors import InputError
from evopem.estimation import absolute_descent
from evopem.estimation.criteria import lies_at_bound
from evopem.estimation.damped_descent import Optimum, descend
from evopem.estimation.pem.constrained_parameters import Gain
from evopem.estimation.polynomial_estimate import ConstraintEffect
from evopem.estimation.search.problem import (
    SearchDiagnostics,
    SearchResult,
    count_confirming,
    count_distinct,
)
from evopem.estimation.state_space.entry_problem import EntryErrors, EntryProblem
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate, criteria_of
from evopem.estimation.state_space.point_model import (
    PointModel,
    degrees_of_freedom,
    filtered,
    sandwich,
)
from evopem.estimation.state_space.pole_coordinates import Block, blocks_of
from evopem.estimation.state_space.problem import (
    POLISH_STEPS,
    POLISH_TOLERANCE,
    STEPS,
    TOLERANCE,
    absolute_scores,
)
from evopem.estimation.state_space.starting_points import from_poles
from evopem.estimation.vector_autoregression import coloured_autocovariances
from evopem.models.constraint_checks import check_constraints, check_named_inputs
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.state_space import StateSpaceModel
from evopem.models.structures import Orders

Array = NDArray[np.float64]
Start = tuple[StateSpaceModel, Array, Array]

# Models of random allowed poles that are descended from.
RANDOM_STARTS = 8
# Last number of the key of their draws.
CONSTRAINED = 1
# Relative distance of two objectives that is rounding.
SAME = 1e-9


@dataclass(frozen=True)
class Demands:
    """What a model is to be fitted for, and what it must meet.

    Attributes
    ----------
    horizon : int
        Samples ahead.
    constraints : Constraints, optional
    """

    horizon: int = 1
    constraints: Constraints | None = None


def check_demands(demands: Demands, errors: StateSpaceErrors) -> None:
    """Refuse constraints that no state-space model can meet, or whose meaning is not clear.

    Raises
    ------
    InputError
        Naming the key of the constraints.
    """
    recording, poles = errors.data.recording, demands.constraints
    if poles is None:
        return
    coefficients = [f"fixed_coefficients.{name}" for name in poles.fixed_coefficients]
    if coefficients or poles.priors:
        raise InputError(
            "constraints",
            "a state-space model has no coefficients of its own, because its matrices depend on"
            " the choice of the states, and a prior counts as an observation of one",
            "constrain poles or the static gain, or use a polynomial structure",
            (*coefficients, "priors")[0],
        )
    names = recording.input_names or ("",)
    check_named_inputs(poles, names)
    inputs, n = recording.inputs.shape[1], errors.order
    na, nf = (n, 0) if errors.innovations else (0, n)
    for name in names:
        own = poles.of_input(name)
        key = "static_gain" if own.static_gain is not None else "static_gain_bounds"
        if own.static_gain is None and own.static_gain_bounds is None:
            check_constraints(own, Orders(nb=n, na=na, nc=na, nf=nf, nk=1), recording.sampling_rate)
            continue
        if recording.outputs.shape[1] > 1 or (
            inputs > 1 and not isinstance(getattr(poles, key), dict)
        ):
            raise InputError(
                "constraints",
                "a model with several channels has a static gain for each input and output, and"
                " it is not said which one is meant",
                "name the input, and estimate one output alone",
                key,
            )
        orders = Orders(nb=n * min(inputs, 1), na=na, nc=na, nf=nf, nk=min(inputs, 1))
        check_constraints(own, orders, recording.sampling_rate)


def meeting(
    free: StateSpaceEstimate,
    errors: StateSpaceErrors,
    demands: Demands,
    settings: SearchSettings,
) -> StateSpaceEstimate:
    """The estimate for errors in focus that meets constraints.

    Parameters
    ----------
    free : StateSpaceEstimate
        For errors of one step, without constraints.
    errors : StateSpaceErrors
        The problem of its model.
    demands : Demands
        Checked.
    settings : SearchSettings

    Raises
    ------
    ValueError
        When no model that meets the constraints has finite errors.
    """
    absolute = settings.objective == "absolute"
    optima: list[tuple[EntryProblem, Optimum]] = []
    without = np.inf
    for number, start in enumerate(_starts(free, errors, demands, settings)):
        problem, point = _problem_at(start, errors, demands)
        if number == 0:
            without = _value(problem, point, absolute)
            if demands.horizon == 1 and abs(without - free.objective) <= SAME * free.objective:
                names, _ = problem.active(point)
                return replace(free, constraints=_effect(demands, without, free.objective, names))
        if absolute:
            optimum = absolute_descent.descend(problem, point, absolute_descent.SEARCH_WIDTH)
        else:
            optimum = descend(problem, point, STEPS, TOLERANCE)
        if np.isfinite(optimum.value):
            optima.append((problem, optimum))
    if not optima:
        raise ValueError("no model that meets the constraints has finite errors")
    problem, optimum = min(optima, key=lambda each: each[1].value)
    best = (
        absolute_descent.polish(problem, optimum.point)
        if absolute
        else descend(problem, optimum.point, POLISH_STEPS, POLISH_TOLERANCE)
    )
    values = tuple(_value(each, found.point, absolute) for each, found in optima)
    value = _value(problem, best.point, absolute)
    spent = sum(each.evaluations for _, each in optima) + best.evaluations
    diagnostics = replace(
        SearchDiagnostics.of_descents(
            value, free.search.diagnostics.evaluations + spent, count_distinct(list(values))
        ),
        restart_minima=(*values, value),
        n_confirming=count_confirming(values, value),
    )
    result = SearchResult(best.point, value, diagnostics)
    return _described(problem, result, free, demands, settings)


def _starts(
    free: StateSpaceEstimate,
    errors: StateSpaceErrors,
    demands: Demands,
    settings: SearchSettings,
) -> Iterator[Start]:
    """Models to descend from: the optimum, and models of allowed poles."""
    yield free.model, free.initial_states, free.segment_levels
    if demands.constraints is None or errors.data.inputs.shape[1] == 0:
        return
    plant = errors.of_structure("ss_oe")
    key = (errors.order, int(errors.innovations), CONSTRAINED)
    generator = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))
    problem, point = _problem_at(
        (free.model, free.initial_states, free.segment_levels), errors, demands
    )
    allowed = [
        np.concatenate(
            [b.poles(point[own]) for b, own in zip(problem.blocks, problem.own, strict=True)]
        )
    ]
    allowed += [
        np.concatenate([_random_poles(block, errors.radius, generator) for block in problem.blocks])
        for _ in range(RANDOM_STARTS)
    ]
    for poles in allowed:
        projection = plant.projection(from_poles(plant, _as_pairs(poles)))
        if np.isfinite(projection.linear).all():
            made = PointModel(plant, projection)
            model = replace(made.model(), structure=errors.structure)
            yield model, made.initial_states(), made.levels()


def _random_poles(
    block: Block, radius: float, generator: np.random.Generator
) -> NDArray[np.complex128]:
    own = block.random(generator)
    if block.codes and block.region is None and not block.known:
        r, angle = radius * generator.random() ** 0.5, np.pi * generator.random()
        pole = r * np.exp(1j * angle)
        return np.array([pole, pole.conjugate()]) if block.states == 2 else np.array([r + 0j])
    return block.poles(own)


def _as_pairs(poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Poles with exactly conjugate pairs, and real ones without an imaginary part."""
    upper = poles[poles.imag > 0.0]
    real = poles[poles.imag == 0.0].real.astype(complex)
    return np.concatenate([upper, upper.conj(), real])


def _problem_at(
    start: Start, errors: StateSpaceErrors, demands: Demands
) -> tuple[EntryProblem, Array]:
    """The problem with sections like those of a model, and its point."""
    data = errors.data
    rate = data.recording.sampling_rate
    blocks = blocks_of(errors.order, demands.constraints, rate, errors.radius, errors.innovations)
    gains = {}
    names: Sequence[str] = data.recording.input_names or [""] * data.inputs.shape[1]
    for column, name in enumerate(names):
        constraints = demands.constraints or Constraints()
        given, bounds = constraints.gain_of(name), constraints.gain_bounds_of(name)
        if given is not None or bounds is not None:
            scale = float(data.input_scales[column] / data.output_scales[0])
            lower, upper = bounds or (given, given)
            gains[column] = Gain(
                None if lower is None else lower * scale, None if upper is None else upper * scale
            )
    problem = EntryProblem(errors, blocks, demands.horizon, gains)
    return problem, problem.begun(problem.point_of(*start))


def _value(problem: EntryProblem, point: Array, absolute: bool) -> float:
    """Errors in focus in percent."""
    return _value_of(problem, problem.projection(point).errors, absolute)


def _value_of(problem: EntryProblem, errors: Array, absolute: bool) -> float:
    """Errors in percent."""
    if absolute:
        value = absolute_descent.criterion(errors / problem.sizes, problem.weighing)
        return 100.0 * (float(np.exp(value)) - absolute_descent.ROUNDING)
    plain = problem.plain
    return plain.percent(plain.criterion(errors.T @ errors / len(errors)))


def _effect(
    demands: Demands, value: float, without: float, active: Sequence[str]
) -> ConstraintEffect | None:
    if demands.constraints is None:
        return None
    names = ["fixed_poles"] if demands.constraints.fixed_poles else []
    if demands.constraints.static_gain:
        names.append("static_gain")
    return ConstraintEffect(value, without, (*names, *active))


def _described(
    problem: EntryProblem,
    result: SearchResult,
    free: StateSpaceEstimate,
    demands: Demands,
    settings: SearchSettings,
) -> StateSpaceEstimate:
    """The estimate at a point."""
    errors, point, absolute = problem.plain, result.point, settings.objective == "absolute"
    data, found = errors.data, problem.projection(point)
    model = problem.model(point)
    radius = float(np.abs(np.concatenate([model.poles(), model.predictor_poles()])).max())
    active = problem.active(point)
    given = sum(len(block.known) for block in problem.blocks)
    given += sum(not gain.codes for gain in problem.gains.values())
    covariance = _covariance(problem, found, active[1], settings)
    levels = np.zeros((data.segments, data.outputs.shape[1]))
    if data.levels:
        levels = data.output_offsets + data.output_scales * found.entries.R[:, : data.levels].T
        levels = levels[data.level_of]
    return replace(
        free,
        model=replace(model, covariance=covariance),
        objective=_value_of(problem, found.one_step, absolute),
        focus_objective=result.value,
        initial_states=found.entries.initial.T.copy(),
        segment_levels=levels,
        search=result,
        constraints=_effect(demands, result.value, free.objective, active[0]),
        at_stability_bound=lies_at_bound(radius, errors.radius),
        **criteria_of(errors, found.one_step, errors.parameters - given, settings.objective),
    )


def _covariance(
    problem: EntryProblem,
    found: EntryErrors,
    unheld: NDArray[np.bool_],
    settings: SearchSettings,
) -> ParameterCovariance | None:
    """Covariance of the entries of the model, zero across active constraints.

    ``H^-1 S H^-1`` as of :func:`.parameter_covariance`.  Errors of several steps are coloured: S
    takes their autocovariances.  None for these under the absolute objective.
    """
    plain = problem.plain
    data = plain.data
    J, scores, weights = (
        found.derivatives[:, :, unheld],
        found.errors,
        plain.weights(found.covariance),
    )
    curvature = weights
    white = plain.innovations and problem.horizon == 1
    if settings.objective == "absolute":
        if problem.horizon > 1 and plain.innovations:
            return None
        found_scores = absolute_scores(plain, scores, problem.weighing)
        if found_scores is None:
            return None
        scores, weights = found_scores
        curvature = weights
    if white:
        gamma = (scores.T @ scores / len(scores))[None]
    else:
        gamma = coloured_autocovariances(scores, data.bounds)
    between = weights @ gamma @ weights
    hessian = np.einsum("tip,ij,tjq->pq", J, curvature, J, optimize=True)
    score = np.zeros_like(hessian)
    for i in range(J.shape[1]):
        for j in range(J.shape[1]):
            of_lags = np.concatenate([between[:0:-1, j, i], between[:, i, j]])
            passed = filtered(J[:, j], of_lags, data.bounds)
            score += J[:, i].T @ passed
    score *= data.samples / degrees_of_freedom(plain)
    mapping = _model_derivatives(problem, found)[:, unheld]
    return sandwich(hessian, score, mapping, plain.order + len(problem.gains))


def _model_derivatives(problem: EntryProblem, found: EntryErrors) -> Array:
    """Derivatives of ``[A, B, C, D, K, level]`` by the point, row by row."""
    data, derivatives = problem.plain.data, found.entries.derivatives
    u, y = data.input_scales, data.output_scales
    kinds, rows, columns = problem.places.T
    parts = []
    by_entry = ((0, "A", 1.0), (1, "B", 1 / u), (4, "C", y[:, None]), (5, "D", y[:, None] / u))
    for kind, name, factors in (*by_entry, (2, "K", 1 / y)):
        part = np.zeros((*problem.shapes[name], problem.dimension))
        chosen = kinds == kind
        part[rows[chosen], columns[chosen]] = derivatives[chosen]
        scaled = part * np.broadcast_to(factors, problem.shapes[name])[:, :, None]
        parts.append(scaled.reshape(-1, problem.dimension))
    level = np.zeros((len(y), problem.dimension))
    for k, share in enumerate(data.level_shares):
        chosen = (kinds == 6) & (columns == k)
        level[rows[chosen]] += share * y[rows[chosen], None] * derivatives[chosen]
    return np.vstack([*parts, level])
