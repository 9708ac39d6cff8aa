"""The ARMAX prediction-error problem as the hybrid search sees it."""

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

# How individuals of a first population come about.
STARTS = ("chapter", "grown")

MAX_ITERATIONS = 200
# A pass over the record costs for one model what it costs for eight: once half of the descents have
# ended, the others get as long again, and stay where they are.
WAIT = 1.0


class Stage(NamedTuple):
    """One BFGS run of a descent.

    The corner of the smoothed absolute value is in mean |e|, the weight of the stability barrier
    in values of the objective, and the tolerance the relative decrease that ends the run.
    """

    corner: float
    barrier: float
    tolerance: float


DESCENT_STAGES = (Stage(0.1, 1e-4, 1e-5), Stage(0.01, 1e-7, 1e-9))
POLISH_STAGES = (Stage(1e-2, 1e-7, 1e-10), Stage(1e-3, 1e-8, 1e-10), Stage(1e-4, 1e-9, 1e-11))
# Random points times samples that a check from random points takes in any case.
LEAST_CHECKED = 2**17
# Factors tried for each individual and step of growth, and those of them that are descended from.
PLACES = 16
DESCENDED = 2
# Added to the unit diagonal of a scaled Gauss-Newton matrix, times its size: directions that the
# data say less about are left to BFGS.
DAMPING = 1e-12
# Smallest ratio of a diagonal entry to the largest one at which a coordinate has any effect.
FELT = 1e-60


class ArmaxProblem:
    """Search problem of one record and order; see :class:`.memetic.Problem`.

    Parameters
    ----------
    errors : PredictionErrorProblem
    start : {"chapter", "grown"}
        ``chapter``: A and B of stage one, C at random.  ``grown``: each individual grown from
        the smallest orders by pairs of roots (:mod:`evopem.estimation.search.incremental_order`).
    """

    def __init__(self, errors: PredictionErrorProblem, start: str = "chapter") -> None:
        self.errors = errors
        self.start = start
        self._regression = fit_arx(
            errors.input, errors.output, errors.orders, errors.recursion_start
        )
        # What stage one alone reaches: the scale of the objective, however bad a point is.
        self._scale = float(self.values(self.random(1, np.random.default_rng(0)))[0])

    @property
    def least_checked(self) -> int:
        """Random points of a check: the shorter the record, the more optima, and the cheaper."""
        return LEAST_CHECKED // self.errors.samples

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A first population, and the evaluations that it took."""
        if self.start == "grown":
            return self._grown(count, generator)
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

    def _grown(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """Individuals that each took the most promising of a few random pairs at every step."""
        problems = [*self._smaller, self]
        points = problems[0].random(DESCENDED * count, generator)
        descents = problems[0].descend(points)
        evaluations = descents.evaluations
        points, values = _best_of_each(descents, count)
        for smaller, larger in pairwise(problems):
            starts = []
            for point, value in zip(points, values, strict=True):
                places = with_factor(smaller.errors, point, random_pairs(PLACES, generator))
                promised = larger._promise(places, value)
                starts.append(places[np.argsort(promised, kind="stable")[:DESCENDED]])
                evaluations += 2 * len(places)
            descents = larger.descend(np.concatenate(starts))
            evaluations += descents.evaluations
            points, values = _best_of_each(descents, count)
        return points, evaluations

    @cached_property
    def _smaller(self) -> list[ArmaxProblem]:
        """The problems on the way from the smallest orders to these, the same for every draw."""
        return [
            ArmaxProblem(self.errors.of_orders(orders))
            for orders in smaller_orders(self.errors.orders)
        ]

    def _promise(self, points: Array, value: float) -> Array:
        """Objective that one Gauss-Newton step from each point promises; inf where infeasible."""
        corners, barriers = self._smoothing(DESCENT_STAGES[0], np.full(len(points), value))
        values, gradients = self.errors.values_and_gradients(points, corners, barriers)
        inverses = _damped_inverses(self.errors.curvatures(points, corners, barriers))
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
        """BFGS with ever sharper corners; never worse than where it began."""
        polished = self._stages(points, POLISH_STAGES)
        before = self.values(points)
        worse = ~(polished.values <= before)
        polished.points[worse], polished.values[worse] = points[worse], before[worse]
        return replace(polished, evaluations=polished.evaluations + len(points))

    def _stages(self, points: Array, stages: tuple[Stage, ...]) -> Descent:
        values = self.values(points)
        evaluations = len(points)
        for stage in stages:
            corners, barriers = self._smoothing(stage, values)
            result = self._bfgs(points, corners, barriers, stage.tolerance)
            points = result.points
            values = self.values(points)
            evaluations += 2 * result.evaluations + len(points)
        return Descent(points, values, result.converged, evaluations)

    def _smoothing(self, stage: Stage, values: Array) -> tuple[Array, Array]:
        """Corner and weight of the barrier for points that start a stage at these values."""
        corners = stage.corner * self._mean_absolute(values)
        return corners, stage.barrier * np.minimum(values, self._scale)

    def _bfgs(self, points: Array, corners: Array, barriers: Array, tolerance: float) -> Descent:
        errors = self.errors
        return descend(
            lambda trial, rows: errors.values_and_gradients(trial, corners[rows], barriers[rows]),
            points,
            lambda at, rows: _damped_inverses(errors.curvatures(at, corners[rows], barriers[rows])),
            MAX_ITERATIONS,
            tolerance,
            wait=WAIT,
        )

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
    # Coordinates without any effect, such as a noise state that has died out, stay where they are.
    felt = diagonal > FELT * diagonal.max(axis=1, keepdims=True)
    scale = np.where(felt, 1.0 / np.sqrt(np.where(felt, diagonal, 1.0)), 0.0)
    scaled = matrices * scale[:, :, None] * scale[:, None, :]
    finite = np.isfinite(scaled).all(axis=(1, 2))
    scaled[~finite] = np.eye(count)
    scale[~finite] = 1.0
    np.einsum("ijj->ij", scaled)[:] = 1.0 + DAMPING * count
    inverses = np.linalg.inv(scaled)
    damped: Array = np.asarray(inverses + np.swapaxes(inverses, 1, 2), dtype=float)
    return 0.5 * damped * scale[:, :, None] * scale[:, None, :]
