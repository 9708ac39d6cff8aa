"""The Fletcher-Powell function as the hybrid search sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.batch_bfgs import Descent, descend
from evopem.fletcher_powell.function import wrap
from evopem.fletcher_powell.objective import Objective

Array = NDArray[np.float64]

# Accepted steps a descent may take: so many, or so many for each coordinate.
MAX_ITERATIONS, MAX_ITERATIONS_EACH = 200, 10
# Relative decrease at which a descent has converged.
TOLERANCE = 1e-9
# A descent by differences that has not come below this share of its lowest value in so many
# evaluations is where the error of the differences holds it; there its gradient counts as zero.
PROGRESS, STALLED = 0.999, 30
# Root mean square of a descent's first trial step over the coordinates, in radians.
FIRST_STEP = 1.0


class FletcherPowellProblem:
    """Search problem of one objective; see :class:`evopem.estimation.search.memetic.Problem`.

    The search runs unbounded and wraps its end points into the box: the faces of the box would
    make false minima of a function that is periodic.
    """

    def __init__(self, objective: Objective) -> None:
        self.objective = objective

    @property
    def least_checked(self) -> int:
        """None: a search that its budget alone ends is not checked."""
        return 0

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """Individuals uniform in the box [-π, π], which takes no evaluation."""
        return self.random(count, generator), 0

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Points uniform in the box."""
        return generator.uniform(-np.pi, np.pi, (count, self.objective.dimension))

    def repair(self, points: Array) -> Array:
        """The images of the points in the box."""
        return wrap(points)

    def values(self, points: Array) -> Array:
        """f of each row, (M,)."""
        return self.objective.values(points)

    def descend(self, points: Array) -> Descent:
        """BFGS from each row to convergence."""
        before = self.objective.evaluations
        result = descend_in_turn(self.objective, points)
        return replace(result, evaluations=self.objective.evaluations - before)

    def polish(self, points: Array) -> Descent:
        """The same: a converged descent on a smooth function has nothing left to polish."""
        return self.descend(points)


def descend_in_turn(objective: Objective, points: Array) -> Descent:
    """Where BFGS ends from each row, in the box, and f there.

    The descents are computed side by side but counted one after another, as they would be made
    without that: none of them knows of the others, so a run that ends in one of them has not
    spent anything on those behind it.

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
