"""The search of identification.  Where descents from a few random points all end at one optimum, it
is over.  Elsewhere independent searches by order extension and section replacement follow, until
enough have ended at the lowest value.  Replacements in it, and descents from roots of C at the
edge, have to find nothing lower.  Models of several inputs have basin hopping before (Leary 2000),
and so have polynomials that share no sections, where memetic restarts are the independent ones."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import SearchSettings
from evopem.estimation.pem.kernels.bfgs import Descent
from evopem.estimation.search import certificate
from evopem.estimation.search.memetic import memetic_search
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import (
    SAME_COARSE_DESCENT,
    BasinHopping,
    BasinHoppingProblem,
    Log,
    SearchProgress,
    SearchResult,
    converged_values,
    count_distinct,
    same_optimum,
    undiscovered,
)
from evopem.estimation.search.section_replacement import SectionReplacement, supports_sections

BATCHES, BATCH = 2, 16  # independent batches of random points, and the points of each
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
# is expected to be lower: a pass over the recording takes eight at the price of one.
DESCENDED, PATIENCE = 8, 6
# Evaluations of a search that is the first pass of a race, and its random points.
FIRST_PASS, FIRST_BATCH = 0, 8
FIRST_ESTIMATES = 4  # the lowest of the estimates by linear algebra that it descends from as well


class _Search(SearchProgress):
    """A search on its way: its problem and draws, and what it has found so far."""

    def __init__(
        self,
        problem: BasinHoppingProblem,
        generator: np.random.Generator,
        log: Log | None,
        known_minimum: float,
    ) -> None:
        super().__init__(problem, generator, log)
        self.one_optimum, self.known_minimum = False, known_minimum
        self.led: list[tuple[float, float]] = []  # values that refutations led from, and to
        self.replacement: SectionReplacement | None = None
        if isinstance(problem, PolynomialProblem):
            replacement = SectionReplacement(problem)
            self.replacement = replacement if replacement.possible else None

    @property
    def restarts(self) -> int:
        """Independent restarts, batches of random points not counted."""
        return len(self.minima) - self.random_points // BATCH

    def agree(self, best: float, *more: float, spent: bool = False) -> bool:
        """Whether random points, or enough restarts, some more among them, ended at the lowest."""
        minima = (*self.minima, *more)
        agreeing = sum(same_optimum(minimum, best) for minimum in minima)
        # Sections that the record may support are those of polynomials.
        given = agreeing, len(minima), self.undiscovered, spent
        enough = certificate.enough_agree(*given, isinstance(self.problem, PolynomialProblem))
        return enough or (self.one_optimum and same_optimum(self.value, best))

    def is_unlikely(self, target: certificate.Target | None) -> bool:
        """Whether further restarts hardly lead to what the search is made for."""
        likely = certificate.AFTER_RESTART if self.restarts else certificate.AFTER_BATCHES
        lowest = min(self.value, self.known_minimum)
        return target is not None and target.is_unlikely(lowest, likely)

    def add(
        self, kind: str, point: Array, value: float, evaluations: int, optima: Sequence[float] = ()
    ) -> None:
        """Count an independent restart, which ends where a refutation of the same optimum did."""
        self.lower(kind, point, value, evaluations, optima)
        self.minima.append(value)
        self.lift()

    def lift(self) -> None:
        """Let restarts at optima that refutations led down from end where these did."""
        for at, lower in self.led:
            for row, minimum in enumerate(self.minima):
                if same_optimum(max(minimum, at), min(minimum, at)):
                    self.minima[row] = lower

    def lower(
        self, kind: str, point: Array, value: float, evaluations: int, optima: Sequence[float] = ()
    ) -> None:
        """Count evaluations and optima of descents, and keep a point that is the lowest."""
        self.optima.extend(optima)
        self.spent += evaluations
        self.reach(point, value)
        if self._log is not None:
            self._log(f"{kind}: {value:.9g}, lowest {self.value:.9g}, {self.spent} evaluations")

    def refute(self, max_evaluations: float) -> None:
        """Look for a lower optimum than that of agreeing restarts: next to it, with exchanged
        poles or at the edge."""
        problem = self.problem
        if not self.one_optimum:
            many = self.undiscovered > certificate.MANY_OPTIMA and max_evaluations == np.inf
            for _ in range(REFUTATIONS if many else 1):
                self.search_neighbours(self.replacement, max_evaluations)
        if isinstance(problem, PolynomialProblem) and self.point is not None:
            before = self.value
            self.descend_from("exchanged poles", *problem.with_exchanged_poles(self.point))
            if problem.errors.orders.nc:
                hopping = problem.from_edge(self.point, self.value, self.generator)
                self.lower("roots of C at the edge", *hopping)
            if not same_optimum(before, self.value):
                self.one_optimum = False
                self.led.append((before, self.value))
                self.lift()

    def search_neighbours(
        self, replacement: SectionReplacement | None, max_evaluations: float
    ) -> None:
        """Look for a lower optimum next to the lowest one; this is no independent restart."""
        if self.point is None:
            return
        plain = partial(basin_hopping, self.problem)
        hop = plain if replacement is None else replacement.search_from
        hopping = hop(self.point, self.value, max_evaluations, self.generator)
        self.lower("neighbours of the lowest", *hopping)

    def descend_from_random_points(self, evaluations: int) -> None:
        """Descend from batches of random points, and polish the lowest of each.  No further batch
        follows one that leaves a hopeless undiscovered probability.  They are polished together,
        because a pass over the recording costs the same for several points as for one."""
        lowest: list[Array] = []
        used = 0
        while not lowest or (
            self.random_points < BATCHES * BATCH
            and used < evaluations
            and self.undiscovered < HOPELESS
        ):
            descents = self.problem.descend(self.problem.random(BATCH, self.generator))
            self.optima.extend(converged_values(descents))
            self.ends += zip(descents.values.tolist(), descents.points, strict=True)
            lowest.append(descents.points[int(np.argmin(descents.values))])
            self.random_points += BATCH
            self.undiscovered = undiscovered(self.optima)
            used += descents.evaluations
        polished = self.problem.polish(np.array(lowest))
        used += polished.evaluations
        for point, value in zip(polished.points, polished.values, strict=True):
            self.add("random points", point, float(value), used // len(lowest))
        self.one_optimum = (
            self.undiscovered <= certificate.ONE_OPTIMUM and count_distinct(self.optima) == 1
        )

    def descend_from(self, kind: str, starts: Array, used: int) -> None:
        """Descend from points, the lowest of more than a batch; this is no independent restart."""
        if len(starts) > BATCH:
            lowest = np.argsort(self.problem.values(starts), kind="stable")[:BATCH]
            starts, used = starts[np.sort(lowest)], used + len(starts)
        if len(starts):
            descents = self.problem.descend(starts)
            ended = self.problem.polish(_lowest_of(descents)[0][None, :])
            used += descents.evaluations + ended.evaluations
            self.lower(kind, ended.points[0], float(ended.values[0]), used)

    def descend_coarsely(self) -> None:
        """The first pass of a race: coarse descents from a few random points, and from the same
        estimates of the recording every time, which are no independent restart: random points alone
        may all lead to an optimum that has swapped the poles of A and D."""
        problem = self.problem
        descend = (
            problem.descend_coarsely if isinstance(problem, PolynomialProblem) else problem.descend
        )
        descents = descend(problem.random(FIRST_BATCH, self.generator))
        self.optima, self.random_points = converged_values(descents), FIRST_BATCH
        self.add("first pass", *_lowest_of(descents), descents.evaluations)
        self.undiscovered = undiscovered(self.optima, SAME_COARSE_DESCENT)
        if isinstance(problem, PolynomialProblem):
            estimates, used = problem.lowest_estimates(FIRST_ESTIMATES)
            if len(estimates):
                descents = descend(estimates)
                self.lower("estimates", *_lowest_of(descents), used + descents.evaluations)

    def restart(self, settings: SearchSettings) -> None:
        """One independent restart, with basin hopping from its end where restarts do not agree."""
        problem, memetic = self.problem, self.restarts < MEMETIC_RESTARTS
        if memetic:
            short = replace(settings, evaluations=min(settings.evaluations, RESTART_EVALUATIONS))
            ended = memetic_search(problem, short, self.generator, agreeing_restarts=NEVER)
            point, value = ended.point, ended.value
            evaluations = ended.diagnostics.evaluations
            self.generations += ended.diagnostics.generations
        else:
            starts, used = problem.draw(BATCH, self.generator)
            descents = problem.descend(starts)
            self.optima.extend(converged_values(descents))
            point, value = _lowest_of(descents)
            evaluations = used + descents.evaluations
        best = min(self.value, self.known_minimum, value)
        left = settings.evaluations - self.spent - evaluations
        if memetic and (left <= 0 or self.agree(best, value)):
            self.add("memetic restart", point, value, evaluations)
            return
        hopping = basin_hopping(problem, point, value, left, self.generator)
        hopping = hopping._replace(evaluations=evaluations + hopping.evaluations)
        self.add("restart and basin hopping", *hopping)


def global_search(
    problem: BasinHoppingProblem,
    settings: SearchSettings,
    generator: np.random.Generator,
    log: Log | None = None,
    known_minimum: float = np.inf,
    target: certificate.Target | None = None,
) -> SearchResult:
    """Minimise the objective of an identification globally.  ``known_minimum``: A value that an
    earlier search reached.  Restarts that agree on a higher one do not end the search.  ``target``:
    the search ends once it is unlikely to get so low.  InputError when no value was finite."""
    search = _Search(problem, generator, log, known_minimum)
    replacement = search.replacement
    if settings.evaluations == FIRST_PASS:
        search.descend_coarsely()
    else:
        search.descend_from_random_points(settings.evaluations)
        if isinstance(problem, PolynomialProblem) and not search.one_optimum:
            starts = problem.lowest_estimates(FIRST_ESTIMATES, slow=True)
            search.descend_from("estimates of slow poles", *starts)
        alone = replacement is not None and replacement.problem.errors.orders.inputs <= 1
        if search.undiscovered >= HOPELESS and not alone:
            search.search_neighbours(None, settings.evaluations - search.spent)
    refuted_from = np.inf
    while True:
        best = min(search.value, known_minimum)
        ended = search.spent >= settings.evaluations or search.is_unlikely(target)
        enough = search.agree(best)
        if enough or (ended and search.agree(best, spent=True)):
            if same_optimum(refuted_from, search.value):
                search.withstood = True
                if isinstance(problem, PolynomialProblem) and search.point is not None:
                    given = problem, search.point, search.value
                    search.supported, used = supports_sections(*given)
                    search.spent += used
                break
            refuted_from = search.value
            search.refute(np.inf if enough else REFUTING * settings.evaluations)
        elif ended:
            break
        elif replacement is not None:
            hopping = replacement.search(settings.evaluations - search.spent, generator)
            search.add("section replacement", *hopping)
        else:
            search.restart(settings)
    return search.result()


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
