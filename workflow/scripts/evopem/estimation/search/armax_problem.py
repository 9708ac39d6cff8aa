"""The ARMAX prediction-error problem as the global search minimises it."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.arx import fit_arx
from evopem.estimation.pem.batch_bfgs import Descent, descend
from evopem.estimation.pem.objective import PredictionErrorProblem
from evopem.estimation.search.incremental_order import random_pairs, smaller_orders, with_factor

Array = NDArray[np.float64]

# How the individuals of a first population are made.
INITIALIZATIONS = ("arx", "incremental_order")

MAX_ITERATIONS = 200
# A pass over the record costs the same for one model as for eight.  Once half of the descents have
# ended, the others get as many trials again, and keep the point they have reached then.
WAIT = 1.0


class Stage(NamedTuple):
    """One BFGS run of a descent.

    The smoothing of the absolute value is in units of mean |e|, the weight of the stability barrier
    in units of the objective, and the tolerance is the relative decrease that ends the run.
    """

    smoothing: float
    barrier: float
    tolerance: float


DESCENT_STAGES = (Stage(0.1, 1e-4, 1e-5), Stage(0.01, 1e-7, 1e-9))
POLISH_STAGES = (Stage(1e-2, 1e-7, 1e-10), Stage(1e-3, 1e-8, 1e-10), Stage(1e-4, 1e-9, 1e-11))
# Random points of a multistart check times samples, at least.
MIN_MULTISTART = 2**17
# Pairs of roots tried for each individual and increment of the order, and those of them that a
# descent starts from.
TRIED_PAIRS = 16
DESCENDED_PAIRS = 2
# Added to the unit diagonal of a scaled Gauss-Newton matrix, times its size: directions that the
# data say less about are left to BFGS.
DAMPING = 1e-12
# Smallest ratio of a diagonal entry to the largest one at which a coordinate is sensitive.
SENSITIVE = 1e-60


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
        smoothing, barriers = self._smoothing(DESCENT_STAGES[0], np.full(len(points), value))
        values, gradients = self.errors.values_and_gradients(points, smoothing, barriers)
        inverses = _damped_inverses(self.errors.curvatures(points, smoothing, barriers))
        return values - 0.5 * np.einsum("ij,ijk,ik->i", gradients, inverses, gradients)

    def repair(self, points: Array) -> Array:
        """Reflect the roots of A and C of infeasible points inside."""
        return self.errors.repair(points)

    def values(self, points: Array) -> Array:
        """Exact objective in percent, (M,)."""
        return self.errors.values(points)

    def descend(self, points: Array) -> Descent:
        """BFGS from each point, preconditioned by its Gauss-Newton matrix."""
        return self._stages(points, DESCENT_STAGES)

    def polish(self, points: Array) -> Descent:
        """BFGS with ever less smoothing; never worse than the starting points."""
        polished = self._stages(points, POLISH_STAGES)
        before = self.values(points)
        worse = ~(polished.values <= before)
        polished.points[worse], polished.values[worse] = points[worse], before[worse]
        return replace(polished, evaluations=polished.evaluations + len(points))

    def _stages(self, points: Array, stages: tuple[Stage, ...]) -> Descent:
        values = self.values(points)
        evaluations = len(points)
        for stage in stages:
            smoothing, barriers = self._smoothing(stage, values)
            result = self._bfgs(points, smoothing, barriers, stage.tolerance)
            points = result.points
            values = self.values(points)
            evaluations += 2 * result.evaluations + len(points)
        return Descent(points, values, result.converged, evaluations)

    def _smoothing(self, stage: Stage, values: Array) -> tuple[Array, Array]:
        """Smoothing and weight of the barrier for points that start a stage at these values."""
        smoothing = stage.smoothing * self._mean_absolute(values)
        return smoothing, stage.barrier * np.minimum(values, self._scale)

    def _bfgs(self, points: Array, smoothing: Array, barriers: Array, tolerance: float) -> Descent:
        def evaluate(trial: Array, rows: NDArray[np.intp]) -> tuple[Array, Array]:
            return self.errors.values_and_gradients(trial, smoothing[rows], barriers[rows])

        def inverse_hessians(at: Array, rows: NDArray[np.intp]) -> Array:
            return _damped_inverses(self.errors.curvatures(at, smoothing[rows], barriers[rows]))

        return descend(evaluate, points, inverse_hessians, MAX_ITERATIONS, tolerance, wait=WAIT)

    def _mean_absolute(self, values: Array) -> Array:
        """Mean |e| of points from their objective; 1 where they are infeasible or exact."""
        mean = self.errors.mean_absolute_residuals(values)
        return np.where(np.isfinite(mean) & (mean > 0.0), mean, 1.0)


def _best_of_each(descents: Descent, count: int) -> tuple[Array, Array]:
    """The best of each of ``count`` equally large groups of neighbouring descents."""
    groups = descents.values.reshape(count, -1)
    best = np.argmin(groups, axis=1) + groups.shape[1] * np.arange(count)
    return descents.points[best], descents.values[best]


def _damped_inverses(matrices: Array) -> Array:
    """Inverses of positive semidefinite matrices, scaled to a unit diagonal and damped."""
    count = matrices.shape[1]
    diagonal = np.einsum("ijj->ij", matrices)
    # Coordinates without any effect, such as a noise state that has decayed, are not changed.
    sensitive = diagonal > SENSITIVE * diagonal.max(axis=1, keepdims=True)
    scale = np.where(sensitive, 1.0 / np.sqrt(np.where(sensitive, diagonal, 1.0)), 0.0)
    scaled = matrices * scale[:, :, None] * scale[:, None, :]
    finite = np.isfinite(scaled).all(axis=(1, 2))
    scaled[~finite] = np.eye(count)
    scale[~finite] = 1.0
    np.einsum("ijj->ij", scaled)[:] = 1.0 + DAMPING * count
    inverses = np.linalg.inv(scaled)
    damped: Array = np.asarray(inverses + np.swapaxes(inverses, 1, 2), dtype=float)
    return 0.5 * damped * scale[:, :, None] * scale[:, None, :]
