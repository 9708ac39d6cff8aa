"""The search of identification.  Where descents from a few random points all end at one optimum, it
is over.  Elsewhere independent searches by order extension and section replacement follow, until
enough have ended at the lowest value.  Replacements in it, and descents from roots of C at the
edge, have to find nothing lower.  Models of several inputs have basin hopping before (Leary 2000),
and so have polynomials that share no sections, where memetic restarts are the independent ones."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import SearchSettings
from evopem.estimation.pem.kernels.bfgs import Descent
from evopem.estimation.search.certificate import (
    AFTER_BATCHES,
    AFTER_RESTART,
    MANY_OPTIMA,
    ONE_OPTIMUM,
    Target,
    enough_agree,
)
from evopem.estimation.search.memetic import memetic_search
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import (
    SAME_COARSE_DESCENT,
    BasinHopping,
    BasinHoppingProblem,
    SearchProgress,
    SearchResult,
    converged_values,
    count_distinct,
    same_optimum,
    undiscovered,
)
from evopem.estimation.search.section_replacement import SectionReplacement

# Independent batches of random points, and the points of each.
BATCHES, BATCH = 2, 16
# Undiscovered probability after a batch from which on another one hardly leads to a certificate,
# and neighbouring optima, or section replacement, have lower values.
HOPELESS = 0.4
# Searches next to an optimum that restarts agree on, where random points find many others; once the
# evaluations are spent one, with this share of them.
REFUTATIONS, REFUTING = 4, 0.2
# Evaluations after which a restart of the memetic search begins no further generation.
RESTART_EVALUATIONS = 4000
# Restarts of the memetic search; where they do not agree, basin hopping from descents finds more.
MEMETIC_RESTARTS = 2
NEVER = 2**31
# Neighbours that a step of basin hopping descends from, and steps without a gain after which none
# is expected to be lower: a pass over the record takes eight at the price of one.
DESCENDED, PATIENCE = 8, 6
# Evaluations of a search that is the first pass of a race, and its random points.
FIRST_PASS, FIRST_BATCH = 0, 8
# The lowest of the estimates by linear algebra that it descends from as well.
FIRST_ESTIMATES = 4


class _Record(SearchProgress):
    """What a search has found so far."""

    def __init__(self, log: Callable[[str], None] | None) -> None:
        super().__init__()
        self.one_optimum = False
        self._log = log

    @property
    def restarts(self) -> int:
        """Independent restarts, batches of random points not counted."""
        return len(self.minima) - self.random_points // BATCH

    def agree(self, best: float, *more: float, spent: bool = False) -> bool:
        """Whether random points, or enough restarts, some more among them, ended at the lowest."""
        minima = (*self.minima, *more)
        agreeing = sum(same_optimum(minimum, best) for minimum in minima)
        enough = enough_agree(agreeing, len(minima), self.undiscovered, spent)
        return enough or (self.one_optimum and same_optimum(self.value, best))

    def is_unlikely(self, target: Target | None, known_minimum: float) -> bool:
        """Whether further restarts hardly lead to what the search is made for."""
        likely = AFTER_RESTART if self.restarts else AFTER_BATCHES
        return target is not None and target.is_unlikely(min(self.value, known_minimum), likely)

    def add(self, kind: str, point: Array, value: float, evaluations: int) -> None:
        """Count an independent restart."""
        self.minima.append(value)
        self.lower(kind, point, value, evaluations)

    def lower(self, kind: str, point: Array, value: float, evaluations: int) -> None:
        """Count evaluations, and keep a point that is the lowest."""
        self.spent += evaluations
        self.reach(point, value)
        if self._log is not None:
            self._log(f"{kind}: {value:.9g}, lowest {self.value:.9g}, {self.spent} evaluations")


def global_search(
    problem: BasinHoppingProblem,
    settings: SearchSettings,
    generator: np.random.Generator,
    log: Callable[[str], None] | None = None,
    known_minimum: float = np.inf,
    target: Target | None = None,
) -> SearchResult:
    """Minimise the objective of an identification globally.  ``known_minimum``: A value that an
    earlier search reached.  Restarts that agree on a higher one do not end the search.  ``target``:
    the search ends once it is unlikely to get so low.  InputError when no value was finite."""
    replacement = SectionReplacement(problem) if isinstance(problem, PolynomialProblem) else None
    state, replacement = _Record(log), replacement if replacement and replacement.possible else None
    if settings.evaluations == FIRST_PASS:
        _descend_coarsely(problem, generator, state)
    else:
        _descend_from_random_points(problem, settings.evaluations, generator, state)
        if isinstance(problem, PolynomialProblem) and not state.one_optimum:
            _descend_from_slow_estimates(problem, state)
        alone = replacement is not None and replacement.problem.errors.orders.inputs <= 1
        if state.undiscovered >= HOPELESS and not alone:
            left = settings.evaluations - state.spent
            _search_neighbours(problem, None, left, generator, state)
    refuted_from = np.inf
    while True:
        best = min(state.value, known_minimum)
        ended = state.spent >= settings.evaluations or state.is_unlikely(target, known_minimum)
        enough = state.agree(best)
        if enough or (ended and state.agree(best, spent=True)):
            if same_optimum(refuted_from, state.value):
                state.withstood = True
                break
            refuted_from = state.value
            limit = np.inf if enough else REFUTING * settings.evaluations
            _refute(problem, replacement, limit, generator, state)
        elif ended:
            break
        elif replacement is not None:
            hopping = replacement.search(settings.evaluations - state.spent, generator)
            state.optima.extend(hopping.optima)
            state.add("section replacement", hopping.point, hopping.value, hopping.evaluations)
        else:
            _restart(problem, settings, generator, state, known_minimum)
    return state.result()


def _refute(
    problem: BasinHoppingProblem,
    replacement: SectionReplacement | None,
    max_evaluations: float,
    generator: np.random.Generator,
    state: _Record,
) -> None:
    """Look for a lower optimum than that of agreeing restarts: a neighbour, or one at the edge."""
    if not state.one_optimum:
        many = state.undiscovered > MANY_OPTIMA and max_evaluations == np.inf
        for _ in range(REFUTATIONS if many else 1):
            _search_neighbours(problem, replacement, max_evaluations, generator, state)
    if isinstance(problem, PolynomialProblem) and state.point is not None:
        before = state.value
        if problem.errors.orders.nc:
            hopping = problem.from_edge(state.point, before, generator)
            state.lower("roots of C at the edge", hopping.point, hopping.value, hopping.evaluations)
        state.one_optimum &= same_optimum(before, state.value)


def _search_neighbours(
    problem: BasinHoppingProblem,
    replacement: SectionReplacement | None,
    max_evaluations: float,
    generator: np.random.Generator,
    state: _Record,
) -> None:
    """Look for a lower optimum next to the lowest one; this is no independent restart."""
    if state.point is None:
        return
    search = partial(basin_hopping, problem) if replacement is None else replacement.search_from
    hopping = search(state.point, state.value, max_evaluations, generator)
    state.optima.extend(hopping.optima)
    state.lower("neighbours of the lowest", hopping.point, hopping.value, hopping.evaluations)


def _descend_from_random_points(
    problem: BasinHoppingProblem, evaluations: int, generator: np.random.Generator, state: _Record
) -> None:
    """Descend from batches of random points, and polish the lowest of each.  No further batch
    follows one that leaves a hopeless undiscovered probability.  They are polished together,
    because a pass over the record costs the same for several points as for one."""
    lowest: list[Array] = []
    used = 0
    while not lowest or (
        state.random_points < BATCHES * BATCH
        and used < evaluations
        and state.undiscovered < HOPELESS
    ):
        descents = problem.descend(problem.random(BATCH, generator))
        state.optima.extend(converged_values(descents))
        lowest.append(descents.points[int(np.argmin(descents.values))])
        state.random_points += BATCH
        state.undiscovered = undiscovered(state.optima)
        used += descents.evaluations
    polished = problem.polish(np.array(lowest))
    used += polished.evaluations
    for point, value in zip(polished.points, polished.values, strict=True):
        state.add("random points", point, float(value), used // len(lowest))
    state.one_optimum = state.undiscovered <= ONE_OPTIMUM and count_distinct(state.optima) == 1


def _descend_from_slow_estimates(problem: PolynomialProblem, state: _Record) -> None:
    """Descend from estimates of a finely sampled record, which are no independent restart."""
    starts, used = problem.lowest_estimates(FIRST_ESTIMATES, slow=True)
    if len(starts):
        descents = problem.descend(starts)
        ended = problem.polish(_lowest_of(descents)[0][None, :])
        used += descents.evaluations + ended.evaluations
        state.lower("estimates of slow poles", ended.points[0], float(ended.values[0]), used)


def _descend_coarsely(
    problem: BasinHoppingProblem, generator: np.random.Generator, state: _Record
) -> None:
    """The first pass of a race: coarse descents from a few random points, and from the same
    estimates of the record every time, which are no independent restart: random points alone may
    all lead to an optimum that has swapped the poles of A and D."""
    descend = (
        problem.descend_coarsely if isinstance(problem, PolynomialProblem) else problem.descend
    )
    descents = descend(problem.random(FIRST_BATCH, generator))
    state.optima, state.random_points = converged_values(descents), FIRST_BATCH
    state.add("first pass", *_lowest_of(descents), descents.evaluations)
    state.undiscovered = undiscovered(state.optima, SAME_COARSE_DESCENT)
    if isinstance(problem, PolynomialProblem):
        estimates, used = problem.lowest_estimates(FIRST_ESTIMATES)
        if len(estimates):
            descents = descend(estimates)
            state.lower("estimates", *_lowest_of(descents), used + descents.evaluations)


def _lowest_of(descents: Descent) -> tuple[Array, float]:
    """Point and value of the lowest end."""
    lowest = int(np.argmin(descents.values))
    return descents.points[lowest], float(descents.values[lowest])


def basin_hopping(
    problem: BasinHoppingProblem,
    point: Array,
    value: float,
    max_evaluations: float,
    generator: np.random.Generator,
) -> BasinHopping:
    """Move from optimum to lower neighbouring optimum until none is found for some time.
    ``max_evaluations``: evaluations after which no further step starts."""
    evaluations = failed = 0
    optima: list[float] = []
    while failed < PATIENCE and evaluations < max_evaluations:
        starts, used = problem.neighbours(point, DESCENDED, generator)
        evaluations += used
        failed += 1
        if not len(starts):
            continue
        descents = problem.descend_from_neighbours(starts)
        evaluations += descents.evaluations
        optima.extend(converged_values(descents))
        ended, lower = _lowest_of(descents)
        if lower < value:
            if not same_optimum(value, lower):
                failed = 0
            point, value = ended, lower
    polished = problem.polish(point[None, :])
    evaluations += polished.evaluations
    return BasinHopping(polished.points[0], float(polished.values[0]), evaluations, optima)


def _restart(
    problem: BasinHoppingProblem,
    settings: SearchSettings,
    generator: np.random.Generator,
    state: _Record,
    known_minimum: float,
) -> None:
    """One independent restart, with basin hopping from its end where restarts do not agree."""
    memetic = state.restarts < MEMETIC_RESTARTS
    if memetic:
        short = replace(settings, evaluations=min(settings.evaluations, RESTART_EVALUATIONS))
        ended = memetic_search(problem, short, generator, agreeing_restarts=NEVER)
        point, value = ended.point, ended.value
        evaluations = ended.diagnostics.evaluations
        state.generations += ended.diagnostics.generations
    else:
        starts, used = problem.draw(BATCH, generator)
        descents = problem.descend(starts)
        state.optima.extend(converged_values(descents))
        point, value = _lowest_of(descents)
        evaluations = used + descents.evaluations
    best = min(state.value, known_minimum, value)
    left = settings.evaluations - state.spent - evaluations
    if memetic and (left <= 0 or state.agree(best, value)):
        state.add("memetic restart", point, value, evaluations)
        return
    hopping = basin_hopping(problem, point, value, left, generator)
    state.optima.extend(hopping.optima)
    state.add(
        "restart and basin hopping", hopping.point, hopping.value, evaluations + hopping.evaluations
    )
