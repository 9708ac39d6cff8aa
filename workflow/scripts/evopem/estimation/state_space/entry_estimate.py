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
from evopem.estimation.polynomial_estimate import ConstraintEffect
from evopem.estimation.search.problem import (
    SearchDiagnostics,
    SearchResult,
    count_confirming,
    count_distinct,
)
from evopem.estimation.state_space.entry_problem import EntryProblem
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate, described
from evopem.estimation.state_space.point_model import Matrices, PointModel
from evopem.estimation.state_space.pole_coordinates import poles_of
from evopem.estimation.state_space.search import problem_for
from evopem.estimation.state_space.starting_points import from_poles
from evopem.models.constraint_checks import check_constraints, check_named_inputs
from evopem.models.structures import Orders

Array = NDArray[np.float64]

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
    problem = EntryProblem(errors, horizon, constraints, settings.objective)
    found = problem_for(errors, settings).projection(free.search.point)
    point = problem.begun(problem.point_of(PointModel(errors, found).matrices))
    begun = problem.percent(problem.projection(point).errors)
    if horizon == 1 and abs(begun - free.objective) <= SAME * free.objective:
        names, _ = problem.active(point)
        return replace(free, constraints=_effect(constraints, begun, free.objective, names))
    begins = [point]
    if constraints is not None and errors.data.inputs.shape[1]:
        begins += [problem.begun(each) for each in _allowed(problem, point, settings)]
    optima = [each for each in map(problem.descend, begins) if np.isfinite(each.value)]
    if not optima:
        raise ValueError("no model that meets the constraints has finite errors")
    best = problem.descend(min(optima, key=lambda each: each.value).point, last=True)
    *values, value = (
        problem.percent(problem.projection(each.point).errors) for each in (*optima, best)
    )
    spent = sum(each.evaluations for each in (*optima, best))
    diagnostics = replace(
        SearchDiagnostics.of_descents(
            value, free.search.diagnostics.evaluations + spent, count_distinct(values)
        ),
        restart_minima=(*values, value),
        n_confirming=count_confirming(tuple(values), value),
    )
    made = described(problem, SearchResult(best.point, value, diagnostics))
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
    allowed = [[point[at] for at in problem.own]]
    allowed += [[block.random(generator) for block in problem.blocks] for _ in range(RANDOM_STARTS)]
    for coordinates in allowed:
        own = zip(problem.blocks, coordinates, strict=True)
        poles = np.concatenate([poles_of(b.values(z)[0])[: b.states] for b, z in own])
        projection = plant.projection(from_poles(plant, poles))
        if np.isfinite(projection.linear).all():
            A, drives, outputs = PointModel(plant, projection).matrices
            gain = np.zeros((errors.order, errors.driving - m))
            drives = np.hstack([drives[:, :m], gain, drives[:, m:]])
            yield problem.point_of(Matrices(A, drives, outputs))


def _effect(
    constraints: Constraints | None, value: float, without: float, active: Sequence[str]
) -> ConstraintEffect | None:
    if constraints is None:
        return None
    names = ["fixed_poles"] if constraints.fixed_poles else []
    if constraints.static_gain:
        names.append("static_gain")
    return ConstraintEffect(value, without, (*names, *active))
