"""The search for the optimum of one order, and of ascending orders, each from its neighbours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from types import MappingProxyType

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import SearchSettings
from evopem.estimation import damped_descent
from evopem.estimation.criteria import limited
from evopem.estimation.damped_descent import Optimum, descend
from evopem.estimation.pem.kernels.bfgs import Descent
from evopem.estimation.search.certificate import AGREEING
from evopem.estimation.search.memetic import memetic_search
from evopem.estimation.search.problem import Log, SearchResult
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.point_model import PointModel
from evopem.estimation.state_space.problem import (
    STEPS,
    TOLERANCE,
    AbsoluteStateSpaceProblem,
    StateSpaceProblem,
)
from evopem.estimation.state_space.starting_models import USUAL_ORDER, StartingModels
from evopem.estimation.state_space.starting_points import (
    extended,
    from_poles,
    point_of_model,
    random_poles,
)
from evopem.models.state_space import StateSpaceModel

NO_MODELS: Mapping[int, StateSpaceModel] = MappingProxyType({})
"""No models of other forms to start from."""

# Pairs of poles tried at a step from smaller orders to larger ones, and those descended from.
PAIRS, DESCENDED = 32, 3
RANDOM_STARTS = 20  # random starts of an order that nothing else leads to
# Steps of all starts of an order in each round, and how many go on: of few states and of many.
ROUNDS, OF_MANY, FEW_STATES = ((10, 3),), ((4, 8), (6, 3)), 10
NEGLIGIBLE = 0.1  # gain of twice the log likelihood that no choice depends on


def descended(
    errors: StateSpaceErrors,
    starts: list[Array],
    count: int,
    steps: int = STEPS,
    tolerance: float = TOLERANCE,
) -> list[Optimum]:
    """Optima from the best starts, the lowest first; infeasible ones are left out."""
    optima = [descend(errors, start, steps, tolerance) for start in lowest(errors, starts, count)]
    optima = [optimum for optimum in optima if np.isfinite(optimum.value)]
    return sorted(optima, key=lambda optimum: optimum.value)


def lowest(errors: StateSpaceErrors, starts: list[Array], count: int) -> list[Array]:
    """The starts of lowest criterion, in this order; A may be unstable there."""
    criteria = []
    for start in starts:
        finite = bool(np.isfinite(start).all())
        criteria.append(errors.criterion(errors.projection(start).covariance) if finite else np.inf)
    order = np.argsort(criteria, kind="stable")[:count]
    return [starts[k] for k in order]


def raced(errors: StateSpaceErrors, starts: list[Array], steps: int) -> list[Optimum]:
    """Optima from starts, the lowest first, which alone is descended to the last digits.

    All take some steps, the lowest go on, and end where no choice depends on what is left.
    """
    rough, remaining = rough_tolerance(errors), steps
    optima = [Optimum(start, np.inf, False, 0) for start in starts]
    left: list[Optimum] = []
    rounds = ROUNDS if errors.order <= FEW_STATES else OF_MANY
    for some, kept in (*rounds, (steps, len(starts))):
        taken = min(some, remaining)
        remaining -= taken
        optima = [
            optimum if optimum.converged or not taken else continued(errors, optimum, taken, rough)
            for optimum in optima
        ]
        # Those whose models are still unstable stay as long as there is room.
        optima = sorted(optima, key=lambda optimum: optimum.value)
        left, optima = optima[kept:] + left, optima[:kept]
    optima = [optimum for optimum in optima + left if np.isfinite(optimum.value)]
    return [continued(errors, optima[0], steps, TOLERANCE), *optima[1:]] if optima else []


def rough_tolerance(errors: StateSpaceErrors) -> float:
    """Tolerance of a descent whose last digits no choice depends on."""
    # N times the criterion is comparable with twice a log likelihood, but for weighting by power.
    least = 0.0 if errors.weighting == "power" else NEGLIGIBLE / errors.data.samples
    return max(least, TOLERANCE)


def continued(errors: StateSpaceErrors, optimum: Optimum, steps: int, tolerance: float) -> Optimum:
    """The optimum that a descent goes on to, with the evaluations of both."""
    ended = descend(errors, optimum.point, steps, tolerance)
    return replace(ended, evaluations=optimum.evaluations + ended.evaluations)


def converted(errors: StateSpaceErrors, form: StateSpaceErrors, point: Array) -> Array:
    """A point of the other form."""
    return point_of_model(PointModel(form, form.projection(point)).model(), errors)


def extensions(
    larger: StateSpaceErrors,
    smaller: StateSpaceErrors,
    point: Array,
    generator: np.random.Generator,
    tried: int = PAIRS,
    kept: int = DESCENDED,
) -> list[Array]:
    """The best of some points that add random poles to the optimum of a smaller order."""
    added = larger.order - smaller.order
    poles = [random_poles(added, generator) for _ in range(tried)]
    return extended(larger, smaller.projection(point), poles, kept)


def reductions(larger: StateSpaceErrors, point: Array) -> list[Array]:
    """The point of an order without one of its pairs of poles, for each of them."""
    rows = larger.layout.rows(point)
    return [np.delete(rows, pair, axis=0).ravel() for pair in range(larger.layout.pairs)]


@dataclass(frozen=True)
class Rung:
    """A problem of one order and its optima, the lowest first."""

    problem: StateSpaceErrors
    optima: list[Optimum]

    def lowered(self, above: Rung, steps: int) -> Rung:
        """With the optimum that begins with that of two states more."""
        if above.problem.order != self.problem.order + 2 or not above.optima:
            return self
        starts = reductions(above.problem, above.optima[0].point)
        reached = descended(self.problem, starts, 1, steps, rough_tolerance(self.problem))
        if reached and (not self.optima or reached[0].value < self.optima[0].value):
            reached = [continued(self.problem, reached[0], steps, TOLERANCE)]
        optima = sorted([*reached, *self.optima], key=lambda optimum: optimum.value)
        return Rung(self.problem, optima)


def rungs(
    errors: StateSpaceErrors,
    models: StartingModels,
    generator: np.random.Generator,
    width: int,
    orders: Sequence[int],
    steps: int = STEPS,
    log: Log | None = None,
    others: Mapping[int, StateSpaceModel] = NO_MODELS,
) -> Iterator[Rung]:
    """Optima of ascending orders from estimates and their neighbours.

    At most ``width`` estimates of each are descended from, the model of another form, and the
    optimum of two states more.
    """
    reached: list[Rung] = []
    yielded = 0
    for order in orders:
        if log is not None:
            log(f"{errors.structure}: order {order} of at most {orders[-1]}")
        problem = replace(errors, order=order)
        beside = [point_of_model(others[order], problem)] if order in others else []
        starts = beside + lowest(problem, list(models.points(problem)), width)
        for below in [rung for rung in reached if rung.optima][-2:]:
            starts += extensions(
                *(problem, below.problem, below.optima[0].point, generator),
                tried=8 * width,
                kept=max(width // 2, 1),
            )
        optima = raced(problem, starts, steps)
        for _ in range(RANDOM_STARTS):
            if optima:
                break
            start = from_poles(problem, random_poles(order, generator))
            optima = descended(problem, [start], 1, steps)
        reached.append(Rung(problem, optima))
        while reached[yielded].problem.order <= order - 2:
            reached[yielded] = reached[yielded].lowered(reached[-1], steps)
            yield reached[yielded]
            yielded += 1
    yield from reached[yielded:]


# Multiplications that a whole search may take, and its evaluations.
BUDGET, LEAST_EVALUATIONS, MOST_EVALUATIONS = 1e11, 500, 8000
# Those of one evaluation from which on a search only descends from estimates, with an input, where
# fewer evaluations are left, and without one.
HEAVY, HEAVY_ALONE = BUDGET / LEAST_EVALUATIONS, 1e8
# Estimates of each order that are descended from on the way to a larger order, and for the order
# itself.
WIDTH, FINAL_WIDTH = 3, 8
CROSSED = 2  # optima of the other form that are descended from
# Restarts that must agree before the multistart check, which is one more: no certificate asks for
# fewer where there are many optima, as there are nearly always.
AGREEING_BEFORE_CHECK = AGREEING - 1


def generator_of(
    settings: SearchSettings, errors: StateSpaceErrors, order: int, sweep: int = 0
) -> np.random.Generator:
    """The source of all draws for an order of a problem."""
    data, form = errors.data, int(not errors.innovations)
    key = (order, form, int(data.levels > 0), *data.delays, sweep)
    return np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))


def is_heavy(errors: StateSpaceErrors) -> bool:
    """Whether a search only descends from estimates, which are good ones of outputs alone."""
    alone = errors.data.inputs.shape[1] == 0
    return errors.cost > (HEAVY_ALONE if alone else HEAVY) or (alone and errors.order > USUAL_ORDER)


def _evaluations(problem: StateSpaceProblem, settings: SearchSettings) -> int:
    """By the size of the problem; the settings limit it, or raise it above their default."""
    raised = max(settings.evaluations / SearchSettings.evaluations, 1.0)
    cost = problem.plain.cost
    if is_heavy(problem.plain) and raised == 1.0:
        return 0
    budgets = np.clip(BUDGET / cost / problem.grams, LEAST_EVALUATIONS, MOST_EVALUATIONS)
    return int(min(settings.evaluations, raised * budgets))


def searched(
    errors: StateSpaceErrors, starts: list[Array], settings: SearchSettings, log: Log | None
) -> tuple[StateSpaceProblem, SearchResult]:
    """Descents from estimates, points and smaller orders, then the search among the optima."""
    problem, generator = problem_for(errors, settings), generator_of(settings, errors, errors.order)
    budget = _evaluations(problem, settings)
    if starts and is_heavy(errors) and budget == 0:
        return problem, _polished(problem, starts, 0)
    plain = without_outliers(problem)
    models = StartingModels(plain, errors.order, errors.cost <= HEAVY)
    given = descended(plain, starts, len(starts))
    points = [optimum.point for optimum in given]
    spent = sum(optimum.evaluations for optimum in given)
    for form in (plain, *_other_form(plain)):
        optima = _optima_from_estimates(form, models, generator, bool(starts), log)
        if form is not plain:
            spent += sum(optimum.evaluations for optimum in optima)
            crossing = [converted(plain, form, optimum.point) for optimum in optima[:CROSSED]]
            optima = descended(plain, crossing, CROSSED)
        points += [optimum.point for optimum in optima]
        spent += sum(optimum.evaluations for optimum in optima)
        if log is not None:
            log(f"starts of {form.structure} form: {len(optima)} optima, {spent} evaluations")
    if problem.objective == "absolute":
        points += starts  # what was an optimum of this objective is none of the quadratic one
    if budget == 0 and points:
        return problem, _polished(problem, points, spent)
    nearest = problem.nearest(points)
    problem.starts, spent = nearest.points, spent + nearest.evaluations
    sizes = SearchSettings(
        mu=8, lambda_=16, nu=6, refine="random", seed=settings.seed, evaluations=max(budget, 1)
    )
    result = memetic_search(
        problem,
        sizes,
        generator,
        log,
        agreeing_restarts=AGREEING_BEFORE_CHECK,
        until_certified=True,
    )
    diagnostics = replace(result.diagnostics, evaluations=result.diagnostics.evaluations + spent)
    return problem, replace(result, diagnostics=diagnostics)


def _optima_from_estimates(
    problem: StateSpaceErrors,
    models: StartingModels,
    generator: np.random.Generator,
    swept: bool,
    log: Log | None,
) -> list[Optimum]:
    """Optima from estimates, and from two states fewer, after all smaller if not yet ``swept``."""
    if is_heavy(problem):
        itself = range(problem.order, problem.order + 1)
        width = 1 if problem.cost > HEAVY else WIDTH
        return next(rungs(problem, models, generator, width, itself)).optima
    starts = list(models.points(problem))
    smaller = range(1 + (problem.order + 1) % 2, problem.order, 2)
    smaller = smaller[-1:] if swept else smaller
    for below in rungs(problem, models, generator, WIDTH, smaller, log=log):
        if below.optima and below.problem.order == problem.order - 2:
            starts += extensions(problem, below.problem, below.optima[0].point, generator)
    if swept:
        return raced(problem, lowest(problem, starts, FINAL_WIDTH), STEPS)
    return descended(problem, starts, FINAL_WIDTH)


def _polished(problem: StateSpaceProblem, starts: list[Array], spent: int) -> SearchResult:
    """The lowest of some points, descended from to the last digits."""
    reached = problem.nearest(starts)
    best = reached.points[[np.argmin(reached.values)]]
    return result_of(problem.polish(best), spent + reached.evaluations, len(starts))


def result_of(descent: Descent, spent: int = 0, optima: int = 1) -> SearchResult:
    """The end of a descent from one point, after others that have spent evaluations."""
    given = descent.points[0], float(descent.values[0]), spent + descent.evaluations
    return SearchResult.of_descents(*given, optima)


def _other_form(errors: StateSpaceErrors) -> tuple[StateSpaceErrors, ...]:
    """The problem of the other form, whose optima are starts, where it is not too large."""
    converse = replace(errors, structure="ss_oe" if errors.innovations else "ss")
    return () if errors.data.inputs.shape[1] == 0 or converse.cost > HEAVY else (converse,)


def likeliest_order(errors: StateSpaceErrors, orders: Sequence[int]) -> int:
    """That of the lowest BIC of estimates by linear algebra, before any descent."""
    models, samples = StartingModels(errors, orders[-1], thorough=False), errors.data.samples
    criteria = dict.fromkeys(orders, np.inf)
    for order in orders:
        problem = replace(errors, order=order)
        # The first point alone: those whose inputs are fitted to poles take far longer.
        for start in lowest(problem, list(islice(models.points(problem), 1)), 1):
            value = problem.criterion(problem.projection(start).covariance)
            criteria[order] = value + problem.parameters * np.log(samples) / samples
    return min(criteria, key=lambda order: criteria[order])


def swept(
    errors: StateSpaceErrors,
    orders: Sequence[int],
    settings: SearchSettings,
    width: int,
    log: Log | None,
    steps: int = STEPS,
    starts: Mapping[int, StateSpaceModel] = NO_MODELS,
) -> Iterator[tuple[StateSpaceProblem, SearchResult]]:
    """The best optimum of each order that the rungs of a ladder reach."""
    usual = min(orders[-1], USUAL_ORDER)
    plain = without_outliers(problem_for(replace(errors, order=usual), settings))
    models = StartingModels(plain, orders[-1], plain.cost <= HEAVY)
    generator = generator_of(settings, errors, usual, 1)
    for rung in rungs(plain, models, generator, width, orders, steps, log, starts):
        if not rung.optima:
            continue
        order = rung.problem.order
        problem = problem_for(replace(errors, order=order), settings)
        result = lowest_of(problem, rung.optima)
        if log is not None:
            spent = result.diagnostics.evaluations
            log(f"order {order}: {result.value:.9g} %, {spent} evaluations")
        yield problem, result


def lowest_of(problem: StateSpaceProblem, optima: list[Optimum]) -> SearchResult:
    """The lowest optimum of the objective next to those of the quadratic one, lowest first."""
    points = [optimum.point for optimum in optima[: problem.descended]]
    reached = problem.nearest(points, damped_descent.SWEEP_WIDTH)
    lowest = int(np.argmin(reached.values))
    spent = sum(optimum.evaluations for optimum in optima) + reached.evaluations
    given = reached.points[lowest], float(reached.values[lowest]), spent
    return SearchResult.of_descents(*given, len(optima))


def without_outliers(problem: StateSpaceProblem) -> StateSpaceErrors:
    """The quadratic problem that is descended from.

    For absolute errors that of outputs less what stands out of the errors of a first optimum, so
    that estimates by linear algebra bear outliers as well.
    """
    errors = problem.plain
    if problem.objective == "quadratic":
        return errors
    models = StartingModels(errors, errors.order, thorough=False)
    optima = descended(errors, list(models.points(errors)), WIDTH)
    if not optima:
        return errors
    left = problem.projection(lowest_of(problem, optima).point).errors
    outputs = errors.data.outputs - (left - limited(left))
    return replace(errors, data=replace(errors.data, outputs=outputs))


def problem_for(errors: StateSpaceErrors, settings: SearchSettings) -> StateSpaceProblem:
    """The search problem of the objective."""
    absolute = settings.objective == "absolute"
    return AbsoluteStateSpaceProblem(errors) if absolute else StateSpaceProblem(errors)
