"""The Fletcher-Powell function as a problem for the product's searches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.bfgs import Descent, descend
from evopem.estimation.search.memetic import discrete_recombination
from fletcher_powell import levenberg_marquardt
from fletcher_powell.function import wrap
from fletcher_powell.objective import Objective

Array = NDArray[np.float64]

# Iterations of a descent at most: the larger of a number and a number times n.
MAX_ITERATIONS, MAX_ITERATIONS_EACH = 200, 10
# Relative decrease at which a descent has converged.
TOLERANCE = 1e-9
# With finite differences a descent ends, by a gradient set to zero, when STALLED evaluations have
# not lowered f below PROGRESS times its lowest value: the error of the differences prevents more.
PROGRESS, STALLED = 0.999, 30
# Steps of a least-squares descent at most, and the relative decreases at which it has converged.
LEAST_SQUARES_STEPS, COARSE, FINE = 100, 1e-3, 1e-11
# Half the side of the cube of the steps to neighbouring points, in radians.
STEP = 2.0
# Root mean square of a descent's first trial step over the coordinates, in radians.
FIRST_STEP = 1.0


class FletcherPowellProblem:
    """Search problem of one objective; see :class:`evopem.estimation.search.problem.Problem`.

    The search is unbounded, and end points are wrapped into the box. The function is periodic;
    bounds would add minima on the faces of the box.
    """

    def __init__(self, objective: Objective) -> None:
        self.objective = objective

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """Draw individuals uniform in the box [-π, π], without evaluations."""
        return self.random(count, generator), 0

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Draw points uniform in the box."""
        return generator.uniform(-np.pi, np.pi, (count, self.objective.dimension))

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Each coordinate from one of two random parents."""
        return discrete_recombination(parents, count, generator)

    def repair(self, points: Array) -> Array:
        """Move the points to their images in the box."""
        return wrap(points)

    def values(self, points: Array) -> Array:
        """f of each row, (M,)."""
        return self.objective.values(points)

    def descend(self, points: Array) -> Descent:
        """Descend from each row by BFGS to convergence."""
        before = self.objective.evaluations
        result = descend_in_turn(self.objective, points)
        return replace(result, evaluations=self.objective.evaluations - before)

    def polish(self, points: Array) -> Descent:
        """Descend from each row; the descents of this problem always run to convergence."""
        return self.descend(points)


class LeastSquaresProblem(FletcherPowellProblem):
    """The same for a search that knows the residuals whose squares f adds up.

    Its descents are the Levenberg-Marquardt descents of the identification.
    """

    def descend(self, points: Array) -> Descent:
        """Descend from each row until steps gain little."""
        return least_squares_in_turn(self.objective, points, COARSE)

    def descend_from_neighbours(self, points: Array) -> Descent:
        """Descend from each row."""
        return self.descend(points)

    def polish(self, points: Array) -> Descent:
        """Descend from each row to the last digits."""
        return least_squares_in_turn(self.objective, points, FINE)

    def neighbours(
        self, point: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Random points in a cube around a point, without evaluations."""
        return point + generator.uniform(-STEP, STEP, (count, len(point))), 0


class _Residuals:
    """The residuals of an objective as the Levenberg-Marquardt descents see them."""

    def __init__(self, objective: Objective) -> None:
        self.residuals = objective.residuals
        self.jacobian = objective.jacobian

    def repaired(self, point: Array) -> Array:
        return wrap(point)

    def percent(self, residuals: Array) -> float:
        return float(residuals @ residuals)


def least_squares_in_turn(objective: Objective, points: Array, tolerance: float) -> Descent:
    """Descend by Levenberg-Marquardt from each row, as :func:`descend_in_turn` does by BFGS.

    A descent has converged when a step lowers f by less than a relative ``tolerance``.
    """
    before = objective.evaluations
    residuals = _Residuals(objective)
    ends = [
        levenberg_marquardt.descend(residuals, point, LEAST_SQUARES_STEPS, tolerance)
        for point in points
    ]
    return Descent(
        points=np.array([end.point for end in ends]),
        values=np.array([end.value for end in ends]),
        converged=np.array([end.converged for end in ends]),
        evaluations=objective.evaluations - before,
    )


def descend_in_turn(objective: Objective, points: Array) -> Descent:
    """Descend by BFGS from each row, and count the descents one after another.

    The descents are computed together for speed. They are independent, so they are counted in the
    order of the rows: a run that ends in one of them has spent nothing on the later ones.

    Parameters
    ----------
    objective : Objective
    points : (M, n) array

    Returns
    -------
    Descent
        End points, wrapped into the box, and their values.

    Raises
    ------
    RunOver
        From the objective.
    """
    count, n = points.shape
    seen: list[list[float]] = [[] for _ in range(count)]
    steepest = np.empty(count)
    lowest, since = np.full(count, np.inf), np.zeros(count, dtype=int)

    def evaluate(trial: Array, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        values, gradients = objective.uncounted(trial)
        for row, value in zip(rows, values, strict=True):
            seen[row].append(float(value))
        if objective.differences:
            since[rows] = np.where(values < PROGRESS * lowest[rows], 0, since[rows] + 1)
            lowest[rows] = np.minimum(lowest[rows], values)
            gradients[since[rows] >= STALLED] = 0.0
        steepest[rows] = np.linalg.norm(gradients, axis=1)
        return values, gradients

    def inverse_hessians(_: Array, rows: NDArray[np.intp]) -> Array:
        scale = FIRST_STEP * np.sqrt(n) / np.maximum(steepest[rows], np.finfo(float).tiny)
        return scale[:, None, None] * np.eye(n)

    most = max(MAX_ITERATIONS, MAX_ITERATIONS_EACH * n)
    result = descend(evaluate, points, inverse_hessians, most, TOLERANCE, refresh=False)
    for values in seen:
        objective.record(np.array(values), gradients=True)
    return replace(result, points=wrap(result.points))
