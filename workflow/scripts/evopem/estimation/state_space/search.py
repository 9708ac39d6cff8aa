"""The search for the optimum of one order, and of all orders: estimates, descents, generations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import SearchSettings
from evopem.estimation.damped_descent import Optimum
from evopem.estimation.search.certificate import AGREEING
from evopem.estimation.search.memetic import memetic_search
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.estimation.state_space.absolute_problem import AbsoluteStateSpaceProblem
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.order_ladder import converted, descended, extensions, rungs
from evopem.estimation.state_space.prepared import FORMS, PreparedRecords
from evopem.estimation.state_space.problem import STEPS, StateSpaceProblem
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.estimation.state_space.starting_models import USUAL_ORDER, StartingModels

Array = NDArray[np.float64]
Log = Callable[[str], None]

# Multiplications of one evaluation from which on a search only descends from estimates, and those
# that a whole search may take.
HEAVY, BUDGET = 1e9, 1e11
LEAST_EVALUATIONS, MOST_EVALUATIONS = 500, 8000
# Estimates of each order that are descended from on the way to a larger order, and for the order
# itself.
WIDTH, FINAL_WIDTH = 3, 8
# Optima of the other form that are descended from.
CROSSED = 2
# Restarts that must agree before the multistart check, which is one more: no certificate asks for
# fewer where there are many optima, as there are nearly always.
AGREEING_BEFORE_CHECK = AGREEING - 1


def generator_of(
    settings: StateSpaceSettings, order: int, form: str, prepared: PreparedRecords, fold: int = 0
) -> np.random.Generator:
    """The source of all draws for an order and a form of some records."""
    key = (order, FORMS.index(form), int(prepared.level), *prepared.delays, fold)
    return np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))


def _evaluations(problem: StateSpaceProblem, settings: StateSpaceSettings) -> int:
    if settings.evaluations is not None:
        return settings.evaluations
    each = problem.errors.cost
    if each > HEAVY:
        return 0
    return int(np.clip(BUDGET / each / problem.grams, LEAST_EVALUATIONS, MOST_EVALUATIONS))


def searched(
    errors: StateSpaceErrors,
    starts: list[Array],
    generator: np.random.Generator,
    settings: StateSpaceSettings,
    log: Log | None,
) -> tuple[StateSpaceProblem, SearchResult]:
    """Descents from estimates and from smaller orders, then the memetic search among them.

    Parameters
    ----------
    errors : StateSpaceErrors
    starts : list of (n,) arrays
        Coordinates that are descended from as well.
    generator : numpy.random.Generator
    settings : StateSpaceSettings
    log : callable, optional
    """
    problem = problem_for(errors, settings)
    budget = _evaluations(problem, settings)
    if starts and errors.cost > HEAVY and budget == 0:
        return problem, _polished(problem, starts, 0)
    plain = without_outliers(problem)
    models = StartingModels(plain, errors.order, errors.cost <= HEAVY)
    given = descended(plain, starts, len(starts))
    points = [optimum.point for optimum in given]
    spent = sum(optimum.evaluations for optimum in given)
    for each in (plain, *_other_form(plain)):
        optima = _optima_from_estimates(each, models, generator, log)
        if each is not plain:
            spent += sum(optimum.evaluations for optimum in optima)
            crossing = [converted(plain, each, optimum.point) for optimum in optima[:CROSSED]]
            optima = descended(plain, crossing, CROSSED)
        points += [optimum.point for optimum in optima]
        spent += sum(optimum.evaluations for optimum in optima)
        if log is not None:
            log(f"starts of {each.form} form: {len(optima)} optima, {spent} evaluations")
    if problem.objective == "absolute":
        points += starts  # what was an optimum of this objective is none of the quadratic one
    if budget == 0 and points:
        return problem, _polished(problem, points, spent)
    spent += problem.start_from(points)
    sizes = SearchSettings(
        mu=8, lambda_=16, nu=6, refine="random", seed=settings.seed, evaluations=max(budget, 1)
    )
    result = memetic_search(
        problem,
        sizes,
        generator,
        log,
        agreeing_restarts=AGREEING_BEFORE_CHECK,
        recombine=problem.recombine,
        until_certified=True,
    )
    diagnostics = replace(result.diagnostics, evaluations=result.diagnostics.evaluations + spent)
    return problem, replace(result, diagnostics=diagnostics)


def _optima_from_estimates(
    problem: StateSpaceErrors,
    models: StartingModels,
    generator: np.random.Generator,
    log: Log | None,
) -> list[Optimum]:
    """Optima from estimates of the order itself, and from the optimum of two states fewer."""
    if problem.cost > HEAVY:
        ((_, optima),) = rungs(
            problem, models, generator, 1, range(problem.order, problem.order + 1)
        )
        return optima
    starts = list(models.points(problem))
    smaller = range(1 + (problem.order + 1) % 2, problem.order, 2)
    for below, optima in rungs(problem, models, generator, WIDTH, smaller, log=log):
        if optima and below.order == problem.order - 2:
            starts += extensions(problem, below, optima[0].point, generator)
    return descended(problem, starts, FINAL_WIDTH)


def _polished(problem: StateSpaceProblem, starts: list[Array], spent: int) -> SearchResult:
    """The lowest of some points, descended from to the last digits."""
    points, used = problem.nearest(starts)
    best = points[int(np.argmin(problem.values(points)))]
    polished = problem.polish(best[None, :])
    value = float(polished.values[0])
    spent += polished.evaluations + used
    diagnostics = SearchDiagnostics.of_descents(value, spent, len(points))
    return SearchResult(polished.points[0], value, diagnostics)


def _other_form(errors: StateSpaceErrors) -> tuple[StateSpaceErrors, ...]:
    """The problem of the other form, whose optima are starts, where it is not too large."""
    if errors.record.inputs.shape[1] == 0:
        return ()
    other = errors.of_form("output_error" if errors.innovations else "innovations")
    return () if other.cost > HEAVY else (other,)


def swept(
    errors: StateSpaceErrors,
    prepared: PreparedRecords,
    orders: range,
    settings: StateSpaceSettings,
    width: int,
    log: Log | None,
    fold: int = 0,
    steps: int = STEPS,
) -> Iterator[tuple[StateSpaceProblem, SearchResult]]:
    """The best optimum of each order that the rungs of a ladder reach."""
    plain = without_outliers(problem_for(errors, settings))
    usual = min(orders[-1], USUAL_ORDER)
    models = StartingModels(plain, orders[-1], errors.of_order(usual).cost <= HEAVY)
    generator = generator_of(settings, usual, errors.form, prepared, 1 + fold)
    for each, optima in rungs(plain, models, generator, width, orders, steps, log):
        if not optima:
            continue
        problem = problem_for(errors.of_order(each.order), settings)
        point, value, used = problem.lowest_of(optima)
        spent = sum(optimum.evaluations for optimum in optima) + used
        if log is not None:
            log(f"order {each.order}: {value:.9g} %, {spent} evaluations")
        diagnostics = SearchDiagnostics.of_descents(value, spent, len(optima))
        yield problem, SearchResult(point, value, diagnostics)


def without_outliers(problem: StateSpaceProblem) -> StateSpaceErrors:
    """The quadratic problem that is descended from: of the outputs without what stands out.

    What stands out of the errors of a first optimum is subtracted from the outputs, so that
    estimates by linear algebra bear outliers as well.  Of the quadratic objective itself nothing.
    """
    errors = problem.errors
    if problem.objective == "quadratic":
        return errors
    models = StartingModels(errors, errors.order, thorough=False)
    optima = descended(errors, list(models.points(errors)), WIDTH)
    if not optima:
        return errors
    found = problem.projection(problem.lowest_of(optima)[0]).errors
    return errors.with_outputs(errors.record.outputs - (found - problem.limited(found)))


def problem_for(errors: StateSpaceErrors, settings: StateSpaceSettings) -> StateSpaceProblem:
    """The search problem of the objective."""
    return (AbsoluteStateSpaceProblem if settings.objective == "absolute" else StateSpaceProblem)(
        errors
    )
