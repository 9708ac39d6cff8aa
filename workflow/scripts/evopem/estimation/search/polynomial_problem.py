"""The prediction-error problem of a polynomial model as the global search sees it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.search.memetic import discrete_recombination
from evopem.estimation.search.polynomial_starts import PolynomialStarts
from evopem.estimation.search.root_recombination import (
    Sections,
    product_of,
    recombined_polynomials,
    sections_of,
)
from evopem.estimation.search.section_hopping import (
    PLACES,
    random_sections,
    section_roots,
    without_nearest_section,
)
from evopem.estimation.search.starting_polynomials import random_denominators

Array = NDArray[np.float64]

# Share of the generations that recombine roots; the others recombine coefficients.
BY_ROOTS = 0.75


class PolynomialProblem(PolynomialStarts):
    """Search problem of one record and orders; see :class:`.problem.Problem`.

    The first population holds the estimates of :class:`.PolynomialStarts`, descended from.  The
    rest of it, and all later populations, have random poles.
    """

    _drawn = False

    @property
    def _polynomials(self) -> list[tuple[str, slice]]:
        return self.errors.polynomials()

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population, and the evaluations that it took; the first one holds the estimates."""
        if self._drawn:
            return self._drawn_at_random(count, generator)
        self._drawn = True
        estimates, used = self._estimates
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
        for name, part in self._polynomials:
            order = part.stop - part.start
            if name in "cd":
                points[1:, part] = generator.standard_normal((count - 1, order))
            else:
                points[:, part] = random_denominators(count, order, generator)
        return self.completed(points)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring whose polynomials have sections, or coefficients, from two parents each.

        One draw decides for a whole generation: the two kinds differ in their values, and the worst
        offspring are refined.
        """
        if generator.random() >= BY_ROOTS:
            return discrete_recombination(parents, count, generator)
        pairs = generator.integers(len(parents), size=(2, count))
        offspring = np.zeros((count, parents.shape[1]))
        for _, part in self._polynomials:
            offspring[:, part] = recombined_polynomials(parents[:, part], pairs, generator)
        return self.completed(offspring)

    def neighbours(
        self,
        point: Array,
        value: float,  # noqa: ARG002 - as of other problems
        count: int,
        generator: np.random.Generator,
    ) -> tuple[Array, int]:
        """The lowest of the points with a section of one or two polynomials elsewhere.

        A section of A or D is moved together with the nearest one of C, or alone.
        """
        moved = []
        own = [part for name, part in self._polynomials if name == "f"]
        a, c, d = (self._parts[name] for name in "acd")
        with_c = c.stop - c.start >= 2
        places: list[tuple[slice, slice | None]] = [(part, None) for part in own]
        for part in (a, d):
            places += [(part, None), (part, c)] if with_c else [(part, None)]
        for part, other in [*places, (c, None)]:
            found = sections_of(point[part])
            for row, section in enumerate(found.quadratic):
                rest = Sections(np.delete(found.quadratic, row, axis=0), found.single)
                monic = np.concatenate([[1.0], product_of(rest)])
                near = (
                    without_nearest_section(point[other], section_roots(section))
                    if other is not None
                    else None
                )
                for factor in random_sections(PLACES, generator):
                    neighbour = point.copy()
                    neighbour[part] = np.convolve(monic, factor)[1:]
                    if other is not None and near is not None:
                        neighbour[other] = np.convolve(near, factor)[1:]
                    moved.append(neighbour)
        if not moved:
            return np.empty((0, len(point))), 0
        points, used = self.completed(np.array(moved))
        values = self.values(points)
        best = np.argsort(values, kind="stable")[:count]
        return points[best], used + len(values)
