"""The ARMAX prediction-error problem as the global search minimises it."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.least_squares import chunks, triangle_of
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.search.descent_problem import DescentProblem
from evopem.estimation.search.incremental_order import random_pairs, smaller_orders, with_factor
from evopem.estimation.search.root_recombination import Sections, product_of, sections_of
from evopem.estimation.search.section_hopping import (
    FARTHEST_NEIGHBOUR,
    PLACES,
    PREDICTION_DAMPING,
    random_sections,
    section_roots,
    without_nearest_section,
)
from evopem.estimation.search.staged_descent import (
    DAMPING,
    promised_values,
)
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# How the individuals of a first population are made.
INITIALIZATIONS = ("arx", "incremental_order")

# Pairs of roots tried for each individual and increment of the order, and those of them that a
# descent starts from.
TRIED_PAIRS = 16
DESCENDED_PAIRS = 2


class ArmaxProblem(DescentProblem[PolynomialErrors]):
    """Search problem of one record and order; see :class:`.memetic.Problem`.

    ``initialization`` {"arx", "incremental_order"}: ``arx``: A and B of stage one, C at random.
    ``incremental_order``: each individual extended from the smallest orders by pairs of roots
    (:mod:`evopem.estimation.search.incremental_order`).
    """

    def __init__(self, errors: PolynomialErrors, initialization: str = "arx") -> None:
        self.errors = errors
        self.initialization = initialization

    @cached_property
    def _regression(self) -> Array:
        """A and B of stage one."""
        errors = self.errors
        return fit_arx(errors.input, errors.output, errors.orders, errors.residual_start)

    @cached_property
    def _largest_value(self) -> float:
        """The objective of stage one, which bounds the weight of the barrier at poor points."""
        return float(self.values(self.random(1, np.random.default_rng(0)))[0])

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A first population, and the evaluations that it took."""
        if self.initialization == "incremental_order":
            return self._by_increments(count, generator)
        return self.random(count, generator), 0

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Individuals with A and B of stage one, C from the standard normal distribution, d = 0.

        One of them has C = 1.  The draw of C is hardly ever invertible as it falls; its roots
        are reflected inside (chapter section 4, as restored).
        """
        orders = self.errors.orders
        points = np.zeros((count, self.errors.dimension))
        regression = orders.na + orders.single.nb
        points[:, :regression] = self._regression
        points[1:, regression : orders.parameters] = generator.standard_normal(
            (count - 1, orders.nc)
        )
        return self.repair(points)

    def _by_increments(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """Individuals extended at every increment by the most promising of a few random pairs."""
        problems = [*self._smaller, self]
        points = problems[0].random(DESCENDED_PAIRS * count, generator)
        descents = problems[0].descend(points)
        evaluations = descents.evaluations
        points, values = _best_of_each(descents, count)
        for smaller, larger in pairwise(problems):
            starts = []
            for point, value in zip(points, values, strict=True):
                places = with_factor(smaller.errors, point, random_pairs(TRIED_PAIRS, generator))
                promised = larger._promise(places, value)
                starts.append(places[np.argsort(promised, kind="stable")[:DESCENDED_PAIRS]])
                evaluations += 2 * len(places)
            descents = larger.descend(np.concatenate(starts))
            evaluations += descents.evaluations
            points, values = _best_of_each(descents, count)
        return points, evaluations

    @cached_property
    def _smaller(self) -> list[ArmaxProblem]:
        """The problems from the smallest orders up to these, the same for every draw."""
        return [
            ArmaxProblem(self.errors.of_orders(orders))
            for orders in smaller_orders(self.errors.orders)
        ]

    def _promise(self, points: Array, value: float, damping: float = DAMPING) -> Array:
        """Objective that one Gauss-Newton step from each point predicts; inf where infeasible."""
        return promised_values(self.errors, points, value, self._largest_value, damping)

    def of_orders(self, orders: Orders) -> ArmaxProblem:
        """The problem of other orders."""
        problem = ArmaxProblem(self.errors.of_orders(orders))
        problem._largest_value = self._largest_value
        return problem

    def neighbours(
        self, point: Array, value: float, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """The most promising points with one section of A, and the nearest of B and C, elsewhere.

        The new section is common to all polynomials.  One Gauss-Newton step predicts its gain.
        """
        points = self.repair(self._with_moved_section(point, generator))
        values = self.values(points)
        points = points[values <= FARTHEST_NEIGHBOUR * value]
        if not len(points):
            return points, len(values)
        promised = self._promise(points, value, PREDICTION_DAMPING)
        promised[promised < 0.0] = np.inf
        best = np.argsort(promised, kind="stable")[:count]
        return points[best], len(values) + 4 * len(points)

    def _with_moved_section(self, point: Array, generator: np.random.Generator) -> Array:
        """Points, (M, n), with each of the sections of A in turn moved to random places."""
        o = self.errors.orders
        a, b, c = np.split(point[: o.parameters], [o.na, o.na + o.single.nb])
        found = sections_of(a)
        moved = []
        for row, section in enumerate(found.quadratic):
            roots = section_roots(section)
            rest = Sections(np.delete(found.quadratic, row, axis=0), found.single)
            of_a = np.concatenate([[1.0], product_of(rest)])
            of_b = (
                without_nearest_section(b[1:] / b[0], roots) if o.single.nb > 2 and b[0] else None
            )
            of_c = without_nearest_section(c, roots)
            for factor in random_sections(PLACES, generator):
                neighbour = point.copy()
                neighbour[: o.na] = np.convolve(of_a, factor)[1:]
                if of_b is not None:
                    neighbour[o.na : o.na + o.single.nb] = b[0] * np.convolve(of_b, factor)
                if of_c is not None:
                    neighbour[o.na + o.single.nb : o.parameters] = np.convolve(of_c, factor)[1:]
                moved.append(neighbour)
        return np.array(moved).reshape(len(moved), len(point))


def _best_of_each(descents: Descent, count: int) -> tuple[Array, Array]:
    """The best of each of ``count`` equally large groups of neighbouring descents."""
    groups = descents.values.reshape(count, -1)
    best = np.argmin(groups, axis=1) + groups.shape[1] * np.arange(count)
    return descents.points[best], descents.values[best]


def _regression_rows(
    input: Array,  # noqa: A002
    output: Array,
    orders: Orders,
    start: int,
    stop: int,
) -> Array:
    """Rows ``[-y_(t-1).., u_(t-nk).., y_t]`` for start <= t < stop, (stop - start, na + nb + 1)."""
    past_outputs = [-output[start - i : stop - i] for i in range(1, orders.na + 1)]
    past_inputs = [
        input[start - orders.single.nk - j : stop - orders.single.nk - j]
        for j in range(orders.single.nb)
    ]
    return np.column_stack([*past_outputs, *past_inputs, output[start:stop]])


def fit_arx(input: Array, output: Array, orders: Orders, start: int) -> Array:  # noqa: A002
    """Least-squares ``[a_1..a_na, b_0..b_(nb-1)]`` of the equation error from ``start`` on.

    Solved by singular values, so that collinear regressors give the shortest solution instead of
    noise.  The result may be unstable; it is a start for the search, not a model.
    """
    samples = len(output)
    triangle = triangle_of(
        _regression_rows(input, output, orders, *chunk) for chunk in chunks(start, samples)
    )
    phi, target = triangle[:, :-1], triangle[:, -1]
    scale = np.linalg.norm(phi, axis=0)
    scale[scale == 0.0] = 1.0
    cutoff = np.finfo(float).eps * (samples - start)  # as for the matrix before its reduction
    solution = np.linalg.lstsq(phi / scale, target, rcond=cutoff)[0]
    coefficients: Array = solution / scale
    return coefficients
