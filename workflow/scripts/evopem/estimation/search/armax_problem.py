"""The ARMAX prediction-error problem as the global search minimises it."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.arx import fit_arx
from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.objective import PredictionErrorProblem
from evopem.estimation.search.incremental_order import random_pairs, smaller_orders, with_factor
from evopem.estimation.search.staged_descent import (
    DESCENT_STAGES,
    damped_inverses,
    polish,
    stage_weights,
    staged_descent,
)

Array = NDArray[np.float64]

# How the individuals of a first population are made.
INITIALIZATIONS = ("arx", "incremental_order")

# Random points of a multistart check times samples, at least.
MIN_MULTISTART = 2**17
# Pairs of roots tried for each individual and increment of the order, and those of them that a
# descent starts from.
TRIED_PAIRS = 16
DESCENDED_PAIRS = 2


class ArmaxProblem:
    """Search problem of one record and order; see :class:`.memetic.Problem`.

    Parameters
    ----------
    errors : PredictionErrorProblem
    initialization : {"arx", "incremental_order"}
        ``arx``: A and B of stage one, C at random.  ``incremental_order``: each individual extended
        from the smallest orders by pairs of roots
        (:mod:`evopem.estimation.search.incremental_order`).
    """

    def __init__(self, errors: PredictionErrorProblem, initialization: str = "arx") -> None:
        self.errors = errors
        self.initialization = initialization
        self._regression = fit_arx(
            errors.input, errors.output, errors.orders, errors.recursion_start
        )
        # The objective of stage one bounds the weight of the barrier at poor points.
        self._scale = float(self.values(self.random(1, np.random.default_rng(0)))[0])

    @property
    def min_multistart(self) -> int:
        """Points of a multistart check: shorter records have more optima and cheaper descents."""
        return MIN_MULTISTART // self.errors.samples

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
        regression = orders.na + orders.nb
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

    def _promise(self, points: Array, value: float) -> Array:
        """Objective that one Gauss-Newton step from each point predicts; inf where infeasible."""
        smoothing, barriers = stage_weights(
            self.errors, DESCENT_STAGES[0], np.full(len(points), value), self._scale
        )
        values, gradients = self.errors.values_and_gradients(points, smoothing, barriers)
        inverses = damped_inverses(self.errors.curvatures(points, smoothing, barriers))
        return values - 0.5 * np.einsum("ij,ijk,ik->i", gradients, inverses, gradients)

    def repair(self, points: Array) -> Array:
        """Reflect the roots of A and C of infeasible points inside."""
        return self.errors.repair(points)

    def values(self, points: Array) -> Array:
        """Exact objective in percent, (M,)."""
        return self.errors.values(points)

    def descend(self, points: Array) -> Descent:
        """BFGS from each point, preconditioned by its Gauss-Newton matrix."""
        return staged_descent(self.errors, points, DESCENT_STAGES, self._scale)

    def polish(self, points: Array) -> Descent:
        """BFGS with ever less smoothing; never worse than the starting points."""
        return polish(self.errors, points, self._scale)


def _best_of_each(descents: Descent, count: int) -> tuple[Array, Array]:
    """The best of each of ``count`` equally large groups of neighbouring descents."""
    groups = descents.values.reshape(count, -1)
    best = np.argmin(groups, axis=1) + groups.shape[1] * np.arange(count)
    return descents.points[best], descents.values[best]
