"""Memetic search: a (mu + lambda) evolution strategy whose mutation is BFGS (chapter section 4).
Offspring are recombined, some (the worst by default) refined, and the best kept.  A converged
population restarts.  When enough restarts agree, a multistart check follows."""

import numpy as np

from evopem.arrays import Array, Indices
from evopem.config.settings import SearchSettings
from evopem.estimation.search.certificate import enough_agree
from evopem.estimation.search.problem import (
    SAME_DESCENT,
    Log,
    Problem,
    SearchProgress,
    SearchResult,
    converged_values,
    same_optimum,
    undiscovered,
)

FIRST_BATCH = 32  # random points of the first batch; each further batch doubles their number
# Undiscovered probability at which the check ends, and the one at which it gives up: there are too
# many local optima to find them all.
SUFFICIENT_PROBABILITY, HOPELESS_PROBABILITY = 0.003, 0.2

REFINE = ("worst", "all", "best", "random")

# Restarts that must end at the lowest value, and be at least half of all, before the check.
AGREEING_RESTARTS = 2
# How many times the evaluations a search may take that only needs further restarts to be certified.
CONFIRMING = 2


def memetic_search(
    problem: Problem,
    settings: SearchSettings,
    generator: np.random.Generator,
    log: Log | None = None,
    agreeing_restarts: int = AGREEING_RESTARTS,
    until_certified: bool = False,
) -> SearchResult:
    """Minimise an objective globally; InputError when no value was finite.

    ``until_certified``: restarts go on after the check until a certificate, where all agree with up
    to twice the evaluations.
    """
    search = _Search(problem, generator, log)

    def agreeing() -> int:
        return sum(same_optimum(minimum, search.value) for minimum in search.minima)

    def agreed() -> bool:
        if until_certified and search.random_points:
            return enough_agree(agreeing(), len(search.minima), search.undiscovered)
        return agreeing() >= agreeing_restarts and 2 * agreeing() >= len(search.minima)

    limit = settings.evaluations
    while search.spent < limit:
        search.restart(settings, limit)
        if not search.random_points and agreed():
            search.check(settings.evaluations)
        if agreed():
            break
        confirming = until_certified and search.random_points and agreeing() == len(search.minima)
        limit = (CONFIRMING if confirming else 1) * settings.evaluations
    return search.result()


class _Search(SearchProgress):
    """What a search has found, and the random points of its multistart check."""

    def check(self, most: int) -> None:
        """Descend from random points until a further local optimum is improbable: one restart.
        After ``most`` evaluations no further batch starts."""
        optima: list[float] = []
        best_point, best_value, evaluations = np.empty(0), np.inf, 0
        while not self.random_points or (
            self.undiscovered > SUFFICIENT_PROBABILITY and evaluations < most
        ):
            batch = max(self.random_points, FIRST_BATCH)
            descents = self.problem.descend(self.problem.random(batch, self.generator))
            self.random_points += batch
            evaluations += descents.evaluations
            optima.extend(converged_values(descents))
            best = int(np.argmin(descents.values))
            if descents.values[best] <= best_value:
                best_point, best_value = descents.points[best], float(descents.values[best])
            self.undiscovered = undiscovered(optima)
            if self.undiscovered > HOPELESS_PROBABILITY:
                break
        polished = self.problem.polish(best_point[None, :])
        self.spent += evaluations + polished.evaluations
        self.optima.extend(optima)
        self.reach(polished.points[0], float(polished.values[0]))
        self.minima.append(float(polished.values[0]))
        if self._log is not None:
            self._log(
                f"multistart check: lowest {self.minima[-1]:.9g} of {self.random_points} points, "
                f"undiscovered probability {self.undiscovered:.2g}, {self.spent} evaluations"
            )

    def restart(self, settings: SearchSettings, limit: int) -> None:
        """Generations of an independent population until it has converged, and a polish.
        ``limit``: evaluations after which no further generation begins."""
        parents, used = self.problem.draw(settings.mu, self.generator)
        values = self.problem.values(parents)
        self.spent += used + len(parents)
        while True:
            parents, values = self._generation(parents, values, settings)
            if self._log is not None:
                self._log(
                    f"restart {len(self.minima) + 1} generation {self.generations}: lowest "
                    f"{values[0]:.9g}, highest parent {values[-1]:.9g}, {self.spent} evaluations"
                )
            if self.spent >= limit or same_optimum(values[-1], values[0], SAME_DESCENT):
                break
        polished = self.problem.polish(parents[:1])
        self.spent += polished.evaluations
        self.reach(polished.points[0], float(polished.values[0]))
        self.minima.append(min(float(polished.values[0]), float(values[0])))

    def _generation(
        self, parents: Array, values: Array, settings: SearchSettings
    ) -> tuple[Array, Array]:
        """Recombine, evaluate, refine by BFGS, and select."""
        problem = self.problem
        recombined, used = problem.recombine(parents, settings.lambda_, self.generator)
        offspring = problem.repair(recombined)
        offspring_values = problem.values(offspring)
        chosen = _chosen(offspring_values, settings, self.generator)
        refined = problem.descend(offspring[chosen])
        offspring[chosen], offspring_values[chosen] = refined.points, refined.values
        pool = np.concatenate([parents, offspring])
        pool_values = np.concatenate([values, offspring_values])
        selected = np.argsort(pool_values, kind="stable")[: settings.mu]
        self.spent += used + len(offspring) + refined.evaluations
        self.generations += 1
        self.optima.extend(converged_values(refined))
        self.reach(pool[selected[0]], float(pool_values[selected[0]]))
        return pool[selected], pool_values[selected]


def discrete_recombination(
    parents: Array, count: int, generator: np.random.Generator
) -> tuple[Array, int]:
    """Offspring with each coordinate from one of two random parents; no evaluations."""
    pairs = generator.integers(len(parents), size=(2, count))
    from_first = generator.random((count, parents.shape[1])) < 0.5
    return np.where(from_first, parents[pairs[0]], parents[pairs[1]]), 0


def _chosen(values: Array, settings: SearchSettings, generator: np.random.Generator) -> Indices:
    """Choose the offspring that BFGS refines."""
    count = min(settings.nu, len(values))
    if settings.refine == "random":
        return generator.permutation(len(values))[:count]
    order = np.argsort(values, kind="stable")
    return {"worst": order[-count:], "best": order[:count], "all": order}[settings.refine]
