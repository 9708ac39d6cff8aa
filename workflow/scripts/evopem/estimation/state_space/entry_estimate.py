"""State-space models for errors of several steps, and those that meet hard constraints.

From the optimum of one step without constraints, and models of allowed poles whose inputs fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.constraints import Constraints
from evopem.config.settings import SearchSettings
from evopem.errors import InputError
from evopem.estimation.criteria import coloured_autocovariances, lies_at_bound
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
from evopem.estimation.state_space.pole_coordinates import poles_of
from evopem.estimation.state_space.problem import absolute_scores
from evopem.estimation.state_space.starting_points import from_poles
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


def check_state_space_constraints(constraints: Constraints, errors: StateSpaceErrors) -> None:
    """InputError for constraints that no state-space model can meet, or of unclear meaning."""
    recording = errors.data.recording
    coefficients = [f"fixed_coefficients.{name}" for name in constraints.fixed_coefficients]
    if coefficients or constraints.priors:
        raise InputError(
            "constraints",
            "a state-space model has no coefficients of its own, because its matrices depend on"
            " the choice of the states, and a prior counts as an observation of one",
            "constrain poles or the static gain, or use a polynomial structure",
            (*coefficients, "priors")[0],
        )
    names = recording.input_names or ("",)
    check_named_inputs(constraints, names)
    inputs, n = recording.inputs.shape[1], errors.order
    na, nf = (n, 0) if errors.innovations else (0, n)
    for name in names:
        own = constraints.of_input(name)
        key = "static_gain" if own.static_gain is not None else "static_gain_bounds"
        if own.static_gain is None and own.static_gain_bounds is None:
            check_constraints(own, Orders(nb=n, na=na, nc=na, nf=nf, nk=1), recording.sampling_rate)
            continue
        if recording.outputs.shape[1] > 1 or (
            inputs > 1 and not isinstance(getattr(constraints, key), dict)
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
    horizon: int,
    constraints: Constraints | None,
    settings: SearchSettings,
) -> StateSpaceEstimate:
    """The estimate for errors so many samples ahead that meets constraints, which are checked.

    ``free``: that of one step without constraints.  ValueError when no allowed model has finite
    errors.
    """

    def problem_at(start: Start) -> tuple[EntryProblem, Array]:
        problem = EntryProblem(errors, horizon, constraints, settings.objective == "absolute")
        return problem, problem.begun(problem.point_of(*start))

    problem, point = problem_at((free.model, free.initial_states, free.segment_levels))
    begun = problem.percent(problem.projection(point).errors)
    if horizon == 1 and abs(begun - free.objective) <= SAME * free.objective:
        names, _ = problem.active(point)
        return replace(free, constraints=_effect(constraints, begun, free.objective, names))
    begins = [(problem, point)]
    if constraints is not None and errors.data.inputs.shape[1]:
        begins += map(problem_at, _allowed(problem, point, settings))
    optima = [(each, each.descend(at)) for each, at in begins]
    optima = [(each, optimum) for each, optimum in optima if np.isfinite(optimum.value)]
    if not optima:
        raise ValueError("no model that meets the constraints has finite errors")
    problem, optimum = min(optima, key=lambda each: each[1].value)
    best = problem.polish(optimum.point)
    values = tuple(each.percent(each.projection(o.point).errors) for each, o in optima)
    value = problem.percent(problem.projection(best.point).errors)
    spent = sum(optimum.evaluations for _, optimum in optima) + best.evaluations
    diagnostics = replace(
        SearchDiagnostics.of_descents(
            value, free.search.diagnostics.evaluations + spent, count_distinct(list(values))
        ),
        restart_minima=(*values, value),
        n_confirming=count_confirming(values, value),
    )
    result = SearchResult(best.point, value, diagnostics)
    return _described(problem, result, free, constraints)


def _allowed(problem: EntryProblem, point: Array, settings: SearchSettings) -> Iterator[Start]:
    """Models of allowed poles, those of a point and random ones, whose inputs fit."""
    errors = problem.plain
    plant = replace(errors, structure="ss_oe")
    key = (errors.order, int(errors.innovations), CONSTRAINED)
    generator = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))
    allowed = [[point[at] for at in problem.own]]
    allowed += [[block.random(generator) for block in problem.blocks] for _ in range(RANDOM_STARTS)]
    for coordinates in allowed:
        own = zip(problem.blocks, coordinates, strict=True)
        poles = np.concatenate([poles_of(b.values(z)[0])[: b.states] for b, z in own])
        # Exactly conjugate pairs, and real poles without an imaginary part.
        upper, real = poles[poles.imag > 0.0], poles[poles.imag == 0.0].real.astype(complex)
        pairs = np.concatenate([upper, upper.conj(), real])
        projection = plant.projection(from_poles(plant, pairs))
        if np.isfinite(projection.linear).all():
            made = PointModel(plant, projection)
            model = replace(made.model(), structure=errors.structure)
            yield model, made.initial_states(), made.levels()


def _effect(
    constraints: Constraints | None, value: float, without: float, active: Sequence[str]
) -> ConstraintEffect | None:
    if constraints is None:
        return None
    names = ["fixed_poles"] if constraints.fixed_poles else []
    if constraints.static_gain:
        names.append("static_gain")
    return ConstraintEffect(value, without, (*names, *active))


def _described(
    problem: EntryProblem,
    result: SearchResult,
    free: StateSpaceEstimate,
    constraints: Constraints | None,
) -> StateSpaceEstimate:
    """The estimate at a point."""
    errors, data = problem.plain, problem.plain.data
    found = problem.projection(result.point)
    model = problem.model(found)
    radius = float(np.abs(np.concatenate([model.poles(), model.noise_zeros()])).max())
    names, unheld = problem.active(result.point)
    given = sum(len(block.known) for block in problem.blocks)
    given += sum(not gain.codes for gain in problem.gains.values())
    levels = np.zeros((data.segments, data.outputs.shape[1]))
    if data.levels:
        at = errors.order + int(data.feedthrough.sum())
        own = found.matrices.outputs[:, at : at + data.levels].T
        levels = data.output_offsets + data.output_scales * own
        levels = levels[data.level_of]
    objective = "absolute" if problem.absolute else "quadratic"
    return replace(
        free,
        model=replace(model, covariance=_covariance(problem, found, unheld)),
        objective=problem.percent(found.one_step),
        focus_objective=result.value,
        initial_states=found.matrices.drives[:, errors.driving :].T.copy(),
        segment_levels=levels,
        search=result,
        constraints=_effect(constraints, result.value, free.objective, names),
        at_stability_bound=lies_at_bound(radius, errors.radius),
        **criteria_of(errors, found.one_step, errors.parameters - given, objective),
    )


def _covariance(
    problem: EntryProblem, found: EntryErrors, unheld: NDArray[np.bool_]
) -> ParameterCovariance | None:
    """Covariance of the entries of the model, zero across active constraints.

    As of :func:`.parameter_covariance`; errors of several steps are coloured.  None for these under
    the absolute objective.
    """
    plain, data = problem.plain, problem.plain.data
    J, scores, weights = problem.derivatives(found)[:, :, unheld], found.errors, None
    of_one_step = problem.horizon == 1
    if not problem.absolute:
        weights = plain.weights(found.covariance)
    elif of_one_step and (of_signs := absolute_scores(plain, scores, problem.weighing)):
        scores, weights = of_signs
    if weights is None:
        return None
    if plain.innovations and of_one_step:
        gamma = (scores.T @ scores / len(scores))[None]
    else:
        gamma = coloured_autocovariances(scores, data.bounds)
    between = weights @ gamma @ weights
    hessian = np.einsum("tip,ij,tjq->pq", J, weights, J, optimize=True)
    score = np.zeros_like(hessian)
    for i in range(J.shape[1]):
        for j in range(J.shape[1]):
            of_lags = np.concatenate([between[:0:-1, j, i], between[:, i, j]])
            passed = filtered(J[:, j], of_lags, data.bounds)
            score += J[:, i].T @ passed
    score *= data.samples / degrees_of_freedom(plain)
    mapping = problem.model_derivatives(found)[:, unheld]
    return sandwich(hessian, score, mapping, plain.order + len(problem.gains))
