"""The hybrid of a (mu + lambda) evolution strategy and BFGS (chapter sections 3.3 and 4).

Each generation recombines the parents, evaluates the offspring, lets BFGS *mutate* a few of them
(by default the worst), and selects the best of parents and offspring.  There is no random
mutation: diversity comes from the first population and recombination, and when a population has
collapsed to one point an independent one is drawn.  The search ends when enough independent
populations have ended at the same best value, or when its evaluations are spent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError

Array = NDArray[np.float64]

MUTATE = ("worst", "all", "best", "random")

# Relative difference of objective values below which two end points count as the same optimum.
SAME_OPTIMUM = 1e-6
# Spread of a population's values at which it has collapsed; its best is polished after that.
COLLAPSED = 1e-5


class Problem(Protocol):
    """What the search needs to know of an objective."""

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A first population, (count, n), and the evaluations that it took."""

    def repair(self, points: Array) -> Array:
        """The points, moved into the feasible region where they lie outside."""

    def values(self, points: Array) -> Array:
        """Objective of each row, (M,)."""

    def descend(self, points: Array) -> tuple[Array, Array, int]:
        """BFGS from each row to convergence: points, values and evaluations spent."""

    def polish(self, points: Array) -> tuple[Array, Array, int]:
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
        all, for the search to stop early.
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
        Best value of each independent population.
    basins : int
        Distinct end values of BFGS among all mutated individuals.
    convergence : tuple of (evaluations, best value)
        One entry a generation, and one after each polish.
    """

    point: Array
    value: float
    evaluations: int
    generations: int
    ends: tuple[float, ...]
    basins: int
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

    Raises
    ------
    InputError
        When not one value was finite.
    """
    best_point, best_value = None, np.inf
    ends: list[float] = []
    basins: list[float] = []
    convergence: list[tuple[int, float]] = []
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
        point, value, used = problem.polish(parents[:1])
        spent += used
        if value[0] < best_value:
            best_point, best_value = point[0].copy(), float(value[0])
        convergence.append((spent, best_value))
        ends.append(min(float(value[0]), float(values[0])))
        agreeing = sum(same_optimum(end, best_value) for end in ends)
        if agreeing >= settings.agreement and 2 * agreeing >= len(ends):
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
        convergence=tuple(convergence),
    )


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
    mutated, mutated_values, used = problem.descend(offspring[chosen])
    offspring[chosen], offspring_values[chosen] = mutated, mutated_values
    pool = np.concatenate([parents, offspring])
    pool_values = np.concatenate([values, offspring_values])
    selected = np.argsort(pool_values, kind="stable")[: settings.mu]
    return (
        pool[selected],
        pool_values[selected],
        len(offspring) + used,
        [float(value) for value in mutated_values if np.isfinite(value)],
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
