"""The ARMAX prediction-error problem as the hybrid search sees it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.arx import fit_arx
from evopem.estimation.bfgs import descend
from evopem.estimation.prediction_error import PredictionErrorProblem

Array = NDArray[np.float64]

MAX_ITERATIONS = 200
# Corners of the smoothed absolute value in mean |e|, and the relative decrease that ends a stage.
DESCENT_STAGES = ((0.1, 1e-6), (0.01, 1e-9))
POLISH_STAGES = ((1e-2, 1e-10), (1e-3, 1e-10), (1e-4, 1e-11))
# Smallest eigenvalue kept of a scaled Gauss-Newton matrix: directions the data say less about
# than this are left to BFGS.
EIGENVALUE_FLOOR = 1e-9
# Smallest ratio of a diagonal entry to the largest one at which a coordinate has any effect.
FELT = 1e-60


class ArmaxProblem:
    """Search problem of one record and order; see :class:`evopem.estimation.hybrid_search.Problem`.

    Parameters
    ----------
    errors : PredictionErrorProblem
    """

    def __init__(self, errors: PredictionErrorProblem) -> None:
        self.errors = errors
        self._arx = fit_arx(errors.input, errors.output, errors.orders, errors.recursion_start)

    def draw(self, count: int, generator: np.random.Generator) -> Array:
        """Individuals with A and B of stage one, C from the standard normal distribution, d = 0.

        One of them has C = 1.  The draw of C is hardly ever invertible as it falls; the search
        repairs it by reflecting its roots (chapter section 4, as restored).
        """
        orders = self.errors.orders
        points = np.zeros((count, self.errors.dimension))
        regression = orders.na + orders.nb
        points[:, :regression] = self._arx
        points[1:, regression : orders.parameters] = generator.standard_normal(
            (count - 1, orders.nc)
        )
        return points

    def repair(self, points: Array) -> Array:
        """Reflect the roots of A and C of infeasible points inside."""
        return self.errors.repair(points)

    def values(self, points: Array) -> Array:
        """Exact objective in percent, (M,)."""
        return self.errors.values(points)

    def descend(self, points: Array) -> tuple[Array, Array, int]:
        """BFGS from each point, preconditioned by its Gauss-Newton matrix."""
        return self._stages(points, DESCENT_STAGES)

    def polish(self, points: Array) -> tuple[Array, Array, int]:
        """BFGS with ever sharper corners; never worse than where it began."""
        polished, values, evaluations = self._stages(points, POLISH_STAGES)
        before = self.values(points)
        worse = ~(values <= before)
        polished[worse], values[worse] = points[worse], before[worse]
        return polished, values, evaluations + len(points)

    def _stages(
        self, points: Array, stages: tuple[tuple[float, float], ...]
    ) -> tuple[Array, Array, int]:
        if self.errors.objective == "quadratic":
            stages = stages[-1:]
        values = self.values(points)
        evaluations = len(points)
        for corner, tolerance in stages:
            points, used = self._bfgs(points, corner * self._mean_absolute(values), tolerance)
            values = self.values(points)
            evaluations += used + len(points)
        return points, values, evaluations

    def _bfgs(self, points: Array, corners: Array, tolerance: float) -> tuple[Array, int]:
        errors = self.errors
        result = descend(
            lambda trial, rows: errors.values_and_gradients(trial, corners[rows]),
            points,
            lambda starts, rows: _damped_inverses(errors.curvatures(starts, corners[rows])),
            MAX_ITERATIONS,
            tolerance,
        )
        return result.points, 2 * result.evaluations + len(points)

    def _mean_absolute(self, values: Array) -> Array:
        """Mean |e| of points from their objective; 1 where they are infeasible or exact."""
        mean = self.errors.mean_absolute_residuals(values)
        return np.where(np.isfinite(mean) & (mean > 0.0), mean, 1.0)


def _damped_inverses(matrices: Array) -> Array:
    """Inverses of positive semidefinite matrices with their small eigenvalues raised to a floor."""
    diagonal = np.einsum("ijj->ij", matrices)
    # Coordinates without any effect, such as a noise state that has died out, stay where they are.
    felt = diagonal > FELT * diagonal.max(axis=1, keepdims=True)
    scale = np.where(felt, 1.0 / np.sqrt(np.where(felt, diagonal, 1.0)), 0.0)
    scaled = matrices * scale[:, :, None] * scale[:, None, :]
    finite = np.isfinite(scaled).all(axis=(1, 2))
    scaled[~finite] = np.eye(matrices.shape[1])
    scale[~finite] = 1.0
    eigenvalues, vectors = np.linalg.eigh(scaled)
    eigenvalues = np.maximum(eigenvalues, EIGENVALUE_FLOOR * eigenvalues[:, -1:])
    inverses = np.einsum("ijk,ik,ilk->ijl", vectors, 1.0 / eigenvalues, vectors)
    damped: Array = inverses * scale[:, :, None] * scale[:, None, :]
    return damped
