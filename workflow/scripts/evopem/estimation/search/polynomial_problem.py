"""Prediction-error problems as the global search minimises them."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.least_squares import chunks, triangle_of
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.descent_problem import NEIGHBOUR_DAMPING, DescentProblem
from evopem.estimation.search.memetic import discrete_recombination
from evopem.estimation.search.polynomial_starts import PolynomialStarts
from evopem.estimation.search.polynomials import (
    random_denominators,
    recombined_polynomials,
    with_moved_section,
)
from evopem.estimation.search.staged_descent import promised_values
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# Share of the generations that recombine roots; the others recombine coefficients.
BY_ROOTS = 0.75
# A neighbour of a larger value than this, relative to the optimum's, is too far away for the
# prediction of its gain by one Gauss-Newton step.
FARTHEST_NEIGHBOUR = 1.2


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


class ArmaxProblem(DescentProblem):
    """Search problem of one record and order, whose random points have A and B of stage one."""

    def __init__(self, errors: PolynomialErrors) -> None:
        self.errors = errors

    @cached_property
    def _regression(self) -> Array:
        """A and B of stage one."""
        errors = self.errors
        start = errors.window.residual_start
        return fit_arx(errors.inputs[:, 0], errors.output, errors.orders, start)

    @cached_property
    def _largest_value(self) -> float:
        """The objective of stage one, which bounds the weight of the barrier at poor points."""
        return float(self.values(self.random(1, np.random.default_rng(0)))[0])

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A first population, and the evaluations that it took."""
        return self.random(count, generator), 0

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Individuals with A and B of stage one, C from the standard normal distribution, d = 0.
        One of them has C = 1.  The draw of C is hardly ever invertible as it falls; its roots are
        reflected inside (chapter section 4, as restored)."""
        orders = self.errors.orders
        points = np.zeros((count, self.errors.dimension))
        regression = orders.na + orders.single.nb
        points[:, :regression] = self._regression
        points[1:, regression : orders.parameters] = generator.standard_normal(
            (count - 1, orders.nc)
        )
        return self.repair(points)

    def of_orders(self, orders: Orders) -> ArmaxProblem:
        """The problem of other orders."""
        problem = ArmaxProblem(self.errors.of_orders(orders))
        problem._largest_value = self._largest_value
        return problem

    def neighbours(
        self, point: Array, value: float, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """The most promising points with one section of A, and the nearest of B and C, elsewhere.
        The new section is common to all polynomials.  One Gauss-Newton step predicts its gain."""
        parts = self.errors.parts()
        others = [(name, parts[name]) for name in "bc"]
        moved = with_moved_section(point, parts["a"], others, generator)
        points = self.repair(np.array(moved).reshape(len(moved), len(point)))
        values = self.values(points)
        points = points[values <= FARTHEST_NEIGHBOUR * value]
        if not len(points):
            return points, len(values)
        promised = promised_values(
            self.errors, points, value, self._largest_value, NEIGHBOUR_DAMPING
        )
        promised[promised < 0.0] = np.inf
        best = np.argsort(promised, kind="stable")[:count]
        return points[best], len(values) + 4 * len(points)


def fit_arx(input: Array, output: Array, orders: Orders, start: int) -> Array:  # noqa: A002
    """Least-squares ``[a_1..a_na, b_0..b_(nb-1)]`` of the equation error from ``start`` on.  Solved
    by singular values: collinear regressors give the shortest solution instead of noise.  The
    result may be unstable; it is a start for the search, not a model."""
    o, samples = orders.single, len(output)

    def rows(first: int, stop: int) -> Array:
        columns = [-output[first - i : stop - i] for i in range(1, o.na + 1)]
        columns += [input[first - o.nk - j : stop - o.nk - j] for j in range(o.nb)]
        return np.column_stack([*columns, output[first:stop]])

    triangle = triangle_of(rows(*chunk) for chunk in chunks(start, samples))
    phi, target = triangle[:, :-1], triangle[:, -1]
    scale = np.linalg.norm(phi, axis=0)
    scale[scale == 0.0] = 1.0
    cutoff = np.finfo(float).eps * (samples - start)  # as for the matrix before its reduction
    solution = np.linalg.lstsq(phi / scale, target, rcond=cutoff)[0]
    coefficients: Array = solution / scale
    return coefficients
