"""What the global search needs to know of an objective, and when two optima are the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from evopem.arrays import Array
from evopem.errors import InputError
from evopem.estimation.pem.kernels.bfgs import Descent

# Relative difference of objective values below which two end points count as the same optimum.
SAME_OPTIMUM = 1e-6
# Relative difference below which the values of descents that were not refined to the last digits,
# or of the individuals of a converged population, count as the same.
SAME_DESCENT = 1e-5
SAME_COARSE_DESCENT = 1e-4  # the same for the coarse descents of a first pass

Log = Callable[[str], None]  # what receives a line about the progress of a search


class Problem(Protocol):
    """An objective, the region it is searched in, and a local descent."""

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """Draw a first population, (count, n), and count the evaluations that it took."""

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Draw independent random points, (count, n), without regard to any optimum."""

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring of a population, (count, n), and the evaluations that they took."""

    def repair(self, points: Array) -> Array:
        """Move points that lie outside into the feasible region."""

    def values(self, points: Array) -> Array:
        """Objective of each row, (M,)."""

    def descend(self, points: Array) -> Descent:
        """Descend from each row by BFGS; values as of :meth:`values`."""

    def polish(self, points: Array) -> Descent:
        """Descend from each row to the last digits."""


class BasinHoppingProblem(Problem, Protocol):
    """A problem whose points have sections of roots."""

    def neighbours(
        self, point: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """The most promising of random neighbours, (at most count, n), and the evaluations."""

    def descend_from_neighbours(self, points: Array) -> Descent:
        """Descend from each row, where the Gauss-Newton matrix may be singular."""


@dataclass(frozen=True)
class SearchDiagnostics:
    """How a search arrived at its optimum, and how far the optimum was confirmed.

    ``evaluations``: a gradient counts as one more.  ``restart_minima``: lowest value of each
    independent restart, a batch of random points being one.  ``n_confirming``: further restarts
    that ended at the lowest.  ``n_local_optima``: distinct values of descents that converged.
    ``n_multistart``: random points descended from.  ``undiscovered_probability``: that another one
    leads to a new optimum; 1 without any.  ``withstood``: whether replacements in the lowest and
    descents from the edge, which follow an agreement, have found nothing lower.  ``supported``:
    whether the record supports every section of an optimum that restarts agree on.  ``descents``:
    from known points, which are no restarts.
    """

    evaluations: int
    generations: int
    restart_minima: tuple[float, ...]
    n_confirming: int
    n_local_optima: int
    n_multistart: int
    undiscovered_probability: float
    convergence: tuple[tuple[int, float], ...]
    withstood: bool = False
    supported: bool = True
    descents: int = 0

    @classmethod
    def none(cls) -> SearchDiagnostics:
        """Of a model that no search was needed for."""
        return cls(0, 0, (), 0, 0, 0, 1.0, ())

    @property
    def n_restarts(self) -> int:
        """Number of independent restarts."""
        return len(self.restart_minima)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Best point of a search, its value, and the diagnostics of the search.  ``point`` (n,).
    ``ends``: values and points of where its restarts, and descents from random points, ended."""

    point: Array
    value: float
    diagnostics: SearchDiagnostics
    ends: tuple[tuple[float, Array], ...] = ()

    @classmethod
    def of_descents(
        cls, point: Array, value: float, spent: int, optima: int, minima: Sequence[float] = ()
    ) -> SearchResult:
        """Of descents without generations, to the lowest of some optima; ``minima`` of restarts."""
        minima = tuple(minima) or (value,)
        agreeing, passed = count_confirming(minima, value), ((spent, value),)
        return cls(
            point, value, SearchDiagnostics(spent, 0, minima, agreeing, optima, 0, 1.0, passed)
        )


class BasinHopping(NamedTuple):
    """Where moves from an optimum ended: point (n,), value, evaluations, values of all descents."""

    point: Array
    value: float
    evaluations: int
    optima: list[float]


class SearchProgress:
    """What a search has found and spent so far."""

    def __init__(
        self, problem: Any, generator: np.random.Generator, log: Log | None = None
    ) -> None:
        self.problem, self.generator, self._log = problem, generator, log
        self.point: Array | None = None
        self.value = np.inf
        self.ends: list[tuple[float, Array]] = []
        self.minima: list[float] = []
        self.optima: list[float] = []
        self.convergence: list[tuple[int, float]] = []
        self.spent = self.generations = 0
        # Random points descended from, and the probability that another one leads elsewhere.
        self.random_points, self.undiscovered = 0, 1.0
        self.withstood, self.supported = False, True

    def reach(self, point: Array, value: float) -> None:
        """Keep a point where it is lower, and note how low the search is by now."""
        if value < self.value:
            self.point, self.value = point.copy(), value
        self.ends.append((value, point.copy()))
        self.convergence.append((self.spent, self.value))

    def result(self) -> SearchResult:
        """The best point of all, with diagnostics.  InputError when no value was finite."""
        if self.point is None:
            problem = "no model that was tried predicts the output with finite errors"
            remedy = "look for values that stand out by many orders of magnitude, and remove them"
            raise InputError("search", problem, remedy)
        diagnostics = SearchDiagnostics(
            evaluations=self.spent,
            generations=self.generations,
            restart_minima=tuple(self.minima),
            n_confirming=count_confirming(tuple(self.minima), self.value),
            n_local_optima=count_distinct(self.optima),
            n_multistart=self.random_points,
            undiscovered_probability=self.undiscovered,
            convergence=tuple(self.convergence),
            withstood=self.withstood,
            supported=self.supported,
        )
        return SearchResult(self.point, self.value, diagnostics, tuple(self.ends))


def descended(problem: Problem, point: Array) -> SearchResult:
    """One descent from a point, (n,), to the last digits, as a search of its own."""
    polished = problem.polish(point[None, :])
    given = polished.points[0], float(polished.values[0]), polished.evaluations
    search = SearchResult.of_descents(*given, 1)
    return replace(search, diagnostics=replace(search.diagnostics, restart_minima=(), descents=1))


def pooled(first: SearchResult, second: SearchResult) -> SearchResult:
    """Combine two searches of one problem that drew independently.  The number of local optima is
    the larger of the two: which of them coincide is not known.  The undiscovered probability is
    that of the one with more random points.  Sections are supported where that was found out."""
    best = second if second.value < first.value else first
    earlier, later = first.diagnostics, second.diagnostics
    drawn = max(earlier, later, key=lambda d: (d.n_multistart, d.undiscovered_probability))
    continued = (
        (earlier.evaluations + spent, min(value, first.value)) for spent, value in later.convergence
    )
    minima = earlier.restart_minima + later.restart_minima
    alike = [r.diagnostics for r in (first, second) if same_optimum(r.value, best.value)]
    tested = [of_search for of_search in alike if of_search.withstood]
    diagnostics = SearchDiagnostics(
        evaluations=earlier.evaluations + later.evaluations,
        generations=earlier.generations + later.generations,
        restart_minima=minima,
        n_confirming=count_confirming(minima, best.value),
        n_local_optima=max(earlier.n_local_optima, later.n_local_optima),
        n_multistart=earlier.n_multistart + later.n_multistart,
        undiscovered_probability=drawn.undiscovered_probability,
        convergence=(*earlier.convergence, *continued),
        withstood=bool(tested),
        supported=bool(tested) and all(of_search.supported for of_search in tested),
        descents=earlier.descents + later.descents,
    )
    return replace(best, diagnostics=diagnostics, ends=first.ends + second.ends)


def same_optimum(value: float, best: float, tolerance: float = SAME_OPTIMUM) -> bool:
    """Whether a value is not above the best by more than a relative tolerance."""
    return bool(np.isfinite(best) and value - best <= tolerance * abs(best))


def count_confirming(minima: tuple[float, ...], best: float) -> int:
    """Count the restarts, other than the one that found it, that ended at the best value."""
    return max(sum(same_optimum(minimum, best) for minimum in minima) - 1, 0)


def count_distinct(values: list[float], tolerance: float = SAME_DESCENT) -> int:
    """Count the groups of values that differ by more than a relative tolerance."""
    count, last = 0, -np.inf
    for value in sorted(values):
        if not np.isfinite(last) or not same_optimum(value, last, tolerance):
            count, last = count + 1, value
    return count


def undiscovered(optima: list[float], tolerance: float = SAME_DESCENT) -> float:
    """Posterior mean of the probability that a further descent leads to an undiscovered optimum.
    After n descents that ended at w distinct optima it is ``w (w + 1) / (n (n - 1))`` (Boender &
    Rinnooy Kan 1987, Bayesian stopping rules for multistart global optimization methods)."""
    distinct, count = count_distinct(optima, tolerance), len(optima)
    return min(distinct * (distinct + 1) / (count * (count - 1)), 1.0) if count > 1 else 1.0


def converged_values(descents: Descent) -> list[float]:
    """List the values of the descents that converged."""
    return [float(value) for value in descents.values[descents.converged]]
