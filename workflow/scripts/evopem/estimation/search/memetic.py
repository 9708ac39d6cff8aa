"""The hybrid of a (mu + lambda) evolution strategy and BFGS (chapter sections 3.3 and 4).

Each generation recombines the parents, evaluates the offspring, lets BFGS *mutate* a few of them
(by default the worst), and selects the best of parents and offspring.  There is no random
mutation: diversity comes from the first population and recombination, and when a population has
collapsed to one point an independent one is drawn.  When enough independent populations have ended
at the same best value, descents from random points check it, as many as it takes until hardly any
could lead to an optimum that has not been seen.  The search ends when that finds nothing better,
or when its evaluations are spent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.estimation.pem.batch_bfgs import Descent

Array = NDArray[np.float64]

MUTATE = ("worst", "all", "best", "random")

# Relative difference of objective values below which two end points count as the same optimum.
SAME_OPTIMUM = 1e-6
# Spread of a population's values at which it has collapsed; its best is polished after that.
COLLAPSED = 1e-5
# Random points that a check begins with; the share of all that may lead to optima not seen yet when
# it ends; and the share at which there are too many optima to see them all.
FIRST_CHECKED = 32
UNSEEN, TOO_MANY = 0.003, 0.2


class Problem(Protocol):
    """What the search needs to know of an objective."""

    @property
    def least_checked(self) -> int:
        """Random points that a check takes in any case: as many as cost little."""

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A first population, (count, n), and the evaluations that it took."""

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent random points, (count, n), that know nothing of any optimum."""

    def repair(self, points: Array) -> Array:
        """The points, moved into the feasible region where they lie outside."""

    def values(self, points: Array) -> Array:
        """Objective of each row, (M,)."""

    def descend(self, points: Array) -> Descent:
        """BFGS from each row, in units of :meth:`values`."""

    def polish(self, points: Array) -> Descent:
        """The same to the last digits, for the few points that end a population."""


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the hybrid search.

    Attributes
    ----------
    mu, lambda_ : int
        Parents and offspring of a generation.
    nu : int
        Offspring mutated by BFGS each generation.
    mutate : {"worst", "all", "best", "random"}
        Which of the offspring BFGS mutates (the chapter's choice, and the three it rejected).
    evaluations : int
        Evaluations after which no new generation starts; a gradient counts as one more.
    agreement : int
        Independent populations that must end at the same best value, and be at least half of
        all, for the search to stop early, once a check from random points agrees.
    """

    mu: int = 15
    lambda_: int = 100
    nu: int = 10
    mutate: str = "worst"
    evaluations: int = 20000
    agreement: int = 2


@dataclass(frozen=True)
class SearchResult:
    """Best point of a search and how it was found.

    Attributes
    ----------
    point : (n,) array
    value : float
    evaluations : int
    generations : int
    ends : tuple of float
        Best value of each independent population; a check from random points counts as one.
    basins : int
        Distinct values among all descents that converged.
    checked : int
        Random points that were descended from to check the best; 0 when no populations agreed.
    unseen : float
        Estimated share of the random points that would lead to optima not seen in that; 1 without.
    convergence : tuple of (evaluations, best value)
        One entry a generation, and one after each polish.
    """

    point: Array
    value: float
    evaluations: int
    generations: int
    ends: tuple[float, ...]
    basins: int
    checked: int
    unseen: float
    convergence: tuple[tuple[int, float], ...]

    @property
    def populations(self) -> int:
        """Independent populations drawn."""
        return len(self.ends)

    @property
    def agreement(self) -> float:
        """Share of the populations, other than the one that found it, that ended at the best.

        0 when there was only one.
        """
        agreeing = sum(same_optimum(end, self.value) for end in self.ends)
        return (agreeing - 1) / (len(self.ends) - 1) if len(self.ends) > 1 else 0.0


def hybrid_search(
    problem: Problem,
    settings: SearchSettings,
    generator: np.random.Generator,
    log: Callable[[str], None] | None = None,
    known: float = np.inf,
) -> SearchResult:
    """Minimise a problem's objective globally.

    Parameters
    ----------
    problem : Problem
    settings : SearchSettings
    generator : numpy.random.Generator
        Every random draw of the search comes from it.
    log : callable, optional
        Receives one line a generation.
    known : float
        A value reached before: populations that agree on a higher one do not end the search.

    Raises
    ------
    InputError
        When not one value was finite.
    """
    best_point, best_value = None, np.inf
    ends: list[float] = []
    basins: list[float] = []
    convergence: list[tuple[int, float]] = []
    check: _Check | None = None
    spent = generations = 0
    while spent < settings.evaluations:
        parents, used = problem.draw(settings.mu, generator)
        values = problem.values(parents)
        spent += used + len(parents)
        while True:
            parents, values, used, descents = _generation(
                problem, settings, parents, values, generator
            )
            spent += used
            generations += 1
            basins.extend(descents)
            if values[0] < best_value:
                best_point, best_value = parents[0].copy(), float(values[0])
            convergence.append((spent, best_value))
            if log is not None:
                log(
                    f"population {len(ends) + 1} generation {generations}: best "
                    f"{values[0]:.9g}, worst parent {values[-1]:.9g}, {spent} evaluations"
                )
            if spent >= settings.evaluations or same_optimum(values[-1], values[0], COLLAPSED):
                break
        polished = problem.polish(parents[:1])
        spent += polished.evaluations
        if polished.values[0] < best_value:
            best_point, best_value = polished.points[0].copy(), float(polished.values[0])
        convergence.append((spent, best_value))
        ends.append(min(float(polished.values[0]), float(values[0])))
        if check is None and _agreed(ends, min(best_value, known), settings):
            check = _from_random_points(problem, settings.evaluations, generator)
            spent += check.evaluations
            basins.extend(check.optima)
            if check.value < best_value:
                best_point, best_value = check.point, check.value
            convergence.append((spent, best_value))
            ends.append(check.value)
            if log is not None:
                log(
                    f"check: best {check.value:.9g} of {check.points} random points, "
                    f"{100 * check.unseen:.2g} % may lead elsewhere, {spent} evaluations"
                )
        if _agreed(ends, min(best_value, known), settings):
            break
    if best_point is None:
        raise InputError(
            "search",
            "no model that was tried predicts the output with finite errors",
            "look for values that stand out by many orders of magnitude, and remove them",
        )
    return SearchResult(
        point=best_point,
        value=best_value,
        evaluations=spent,
        generations=generations,
        ends=tuple(ends),
        basins=_distinct(basins),
        checked=check.points if check else 0,
        unseen=check.unseen if check else 1.0,
        convergence=tuple(convergence),
    )


@dataclass(frozen=True)
class _Check:
    """What descents from random points found: the best, and the values of all that converged."""

    point: Array
    value: float
    optima: tuple[float, ...]
    points: int
    unseen: float
    evaluations: int


def _from_random_points(problem: Problem, budget: int, generator: np.random.Generator) -> _Check:
    """Descend from random points until hardly any could lead to an optimum not seen yet.

    Beyond what costs little, not after as many evaluations as the search may take are spent.

    The posterior mean of that share, after n descents that ended at w optima, is
    ``w (w + 1) / (n (n - 1))`` (Boender & Rinnooy Kan 1987, Bayesian stopping rules for multistart
    global optimization methods).
    """
    optima: list[float] = []
    best_point, best_value = np.empty(0), np.inf
    points = evaluations = 0
    unseen = 1.0
    while points < problem.least_checked or (unseen > UNSEEN and evaluations < budget):
        more = max(points, FIRST_CHECKED)
        descents = problem.descend(problem.random(more, generator))
        points += more
        evaluations += descents.evaluations
        optima.extend(_converged(descents))
        best = int(np.argmin(descents.values))
        if descents.values[best] <= best_value:
            best_point, best_value = descents.points[best], float(descents.values[best])
        seen, count = _distinct(optima), len(optima)
        unseen = min(seen * (seen + 1) / (count * (count - 1)), 1.0) if count > 1 else 1.0
        if unseen > TOO_MANY:
            break
    polished = problem.polish(best_point[None, :])
    return _Check(
        point=polished.points[0],
        value=float(polished.values[0]),
        optima=tuple(optima),
        points=points,
        unseen=unseen,
        evaluations=evaluations + polished.evaluations,
    )


def _agreed(ends: list[float], best: float, settings: SearchSettings) -> bool:
    agreeing = sum(same_optimum(end, best) for end in ends)
    return agreeing >= settings.agreement and 2 * agreeing >= len(ends)


def _converged(descents: Descent) -> list[float]:
    """The values of the descents that came to their ends."""
    return [float(value) for value in descents.values[descents.converged]]


def pooled(first: SearchResult, second: SearchResult) -> SearchResult:
    """Two searches of one problem with independent draws, as one.

    The larger number of basins stands, since which of them are the same is no longer known.
    """
    best = second if second.value < first.value else first
    continued = (
        (first.evaluations + spent, min(value, first.value)) for spent, value in second.convergence
    )
    return SearchResult(
        point=best.point,
        value=best.value,
        evaluations=first.evaluations + second.evaluations,
        generations=first.generations + second.generations,
        ends=first.ends + second.ends,
        basins=max(first.basins, second.basins),
        checked=first.checked + second.checked,
        unseen=min(first.unseen, second.unseen),
        convergence=(*first.convergence, *continued),
    )


def _generation(
    problem: Problem,
    settings: SearchSettings,
    parents: Array,
    values: Array,
    generator: np.random.Generator,
) -> tuple[Array, Array, int, list[float]]:
    """Recombine, evaluate, mutate by BFGS, evaluate, select."""
    offspring = problem.repair(_recombine(parents, settings.lambda_, generator))
    offspring_values = problem.values(offspring)
    chosen = _chosen(offspring_values, settings, generator)
    mutated = problem.descend(offspring[chosen])
    offspring[chosen], offspring_values[chosen] = mutated.points, mutated.values
    pool = np.concatenate([parents, offspring])
    pool_values = np.concatenate([values, offspring_values])
    selected = np.argsort(pool_values, kind="stable")[: settings.mu]
    return (
        pool[selected],
        pool_values[selected],
        len(offspring) + mutated.evaluations,
        _converged(mutated),
    )


def _recombine(parents: Array, count: int, generator: np.random.Generator) -> Array:
    """Discrete recombination: each coordinate from one of two parents drawn at random."""
    pairs = generator.integers(len(parents), size=(2, count))
    from_first = generator.random((count, parents.shape[1])) < 0.5
    return np.where(from_first, parents[pairs[0]], parents[pairs[1]])


def _chosen(
    values: Array, settings: SearchSettings, generator: np.random.Generator
) -> NDArray[np.intp]:
    """Which offspring BFGS mutates."""
    count = min(settings.nu, len(values))
    order = np.argsort(values, kind="stable")
    if settings.mutate == "worst":
        return order[-count:]
    if settings.mutate == "best":
        return order[:count]
    if settings.mutate == "random":
        return generator.permutation(len(values))[:count]
    return order


def same_optimum(value: float, best: float, tolerance: float = SAME_OPTIMUM) -> bool:
    """Whether a value is not above the best by more than a relative tolerance."""
    return bool(value - best <= tolerance * abs(best))


def _distinct(values: list[float]) -> int:
    """Number of groups of values that differ by more than the tolerance."""
    count, last = 0, -np.inf
    for value in sorted(values):
        if not np.isfinite(last) or not same_optimum(value, last, COLLAPSED):
            count, last = count + 1, value
    return count
