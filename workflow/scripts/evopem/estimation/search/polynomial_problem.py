"""The prediction-error problem of a polynomial model as the global search sees it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.search.memetic import discrete_recombination
from evopem.estimation.search.polynomial_starts import PolynomialStarts
from evopem.estimation.search.sections import recombined_polynomials, with_moved_section
from evopem.estimation.search.starting_polynomials import random_denominators

Array = NDArray[np.float64]

# Share of the generations that recombine roots; the others recombine coefficients.
BY_ROOTS = 0.75


class PolynomialProblem(PolynomialStarts):
    """Search problem of one record and orders.  The first population holds the estimates of
    :class:`.PolynomialStarts`, descended from.  The rest of it, and all later populations, have
    random poles."""

    _drawn = False

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population, and the evaluations that it took; the first one holds the estimates."""
        if self._drawn:
            return self._drawn_at_random(count, generator)
        self._drawn = True
        estimates, used = self.estimates
        descents = self.descend(estimates)
        random, more = self._drawn_at_random(max(count - len(estimates), count // 3), generator)
        points = np.concatenate([descents.points, random])
        best = np.argsort(self.values(points), kind="stable")[:count]
        return points[best], used + descents.evaluations + more + len(points)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random A, C, D and F; the rest follows by least squares."""
        return self._drawn_at_random(count, generator)[0]

    def _drawn_at_random(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        points = np.zeros((count, self.errors.dimension))
        for name, part in self.errors.polynomials():
            order = part.stop - part.start
            if name in "cd":
                points[1:, part] = generator.standard_normal((count - 1, order))
            else:
                points[:, part] = random_denominators(count, order, generator)
        return self.completed(points)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring whose polynomials have sections, or coefficients, from two parents each.  One
        draw decides for a whole generation: the two kinds differ in their values, and the worst
        offspring are refined."""
        if generator.random() >= BY_ROOTS:
            return discrete_recombination(parents, count, generator)
        pairs = generator.integers(len(parents), size=(2, count))
        offspring = np.zeros((count, parents.shape[1]))
        for _, part in self.errors.polynomials():
            offspring[:, part] = recombined_polynomials(parents[:, part], pairs, generator)
        return self.completed(offspring)

    def neighbours(
        self,
        point: Array,
        value: float,  # noqa: ARG002 - as of other problems
        count: int,
        generator: np.random.Generator,
    ) -> tuple[Array, int]:
        """The lowest of the points with a section of one or two polynomials elsewhere.  A section
        of A or D is moved together with the nearest one of C, or alone."""
        a, c, d = (self._parts[name] for name in "acd")
        places: list[tuple[slice, list[tuple[str, slice]]]] = [
            (part, []) for name, part in self.errors.polynomials() if name == "f"
        ]
        for part in (a, d):
            places += [(part, []), (part, [("c", c)])] if c.stop - c.start >= 2 else [(part, [])]
        moved = []
        for part, others in [*places, (c, [])]:
            moved += with_moved_section(point, part, others, generator)
        if not moved:
            return np.empty((0, len(point))), 0
        points, used = self.completed(np.array(moved))
        values = self.values(points)
        best = np.argsort(values, kind="stable")[:count]
        return points[best], used + len(values)
