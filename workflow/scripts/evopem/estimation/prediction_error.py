"""The prediction-error problem of one record and one model order, for whole populations at once.

A *point* is a parameter vector ``p = [a_1..a_na, b_0..b_(nb-1), c_1..c_nc]`` (chapter eq. 18)
followed by the noise state ``d_0..d_(nc-1)``: what the unknown noise before the first residual has
to do with the residuals after it.  Estimated along with p, it leaves no transient, however slow
the roots of C; a fixed zero would, and on a twice-differenced record, whose C has roots close to
the unit circle, that transient would decide between the orders.  A population is an (M, n + nc)
array.  Numerics only: no search lives here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.estimation import kernels
from evopem.models.armax import Orders
from evopem.models.polynomials import reflect_into_disc

Array = NDArray[np.float64]

OBJECTIVES = ("absolute", "quadratic")

# What the square of a noise state weighs against that of a residual: a prior of ten standard
# deviations of the innovations.  Where C forgets its start before the first scored residual, a
# state of any size would fit a few residuals more, and the search would have no end.
STATE_WEIGHT = 1e-2
# Width of the kernel that estimates the density of the residuals at zero, in mean |e|.
DENSITY_BANDWIDTH = 0.3


@dataclass(frozen=True)
class _Workspace:
    """Buffers of one pass of eight models, reused from pass to pass."""

    parameters: Array
    residuals: Array
    slope: Array
    gradient: Array
    total: Array
    corner: Array


class PredictionErrorProblem:
    """Objective, gradient, curvature and feasibility of ARMAX parameters on one record.

    Parameters
    ----------
    input, output : (N,) arrays
        The record; not modified.
    orders : Orders
    objective : {"absolute", "quadratic"}
        ``absolute``: ``100 sum|e| / sum|y|`` (chapter eq. 20-21, as ``100 - fit``);
        ``quadratic``: ``100 sum e**2 / sum y**2`` (eq. 22).
    recursion_start : int
        First residual, at least ``orders.first_residual``.  One number for all orders that are
        compared, so that a smaller model is a special case of a larger one.
    scoring_start : int
        First residual that counts, at least nc later: nc residuals are fitted by the noise state.
    max_root_radius : float
        Largest allowed radius of the roots of A and C.
    """

    def __init__(
        self,
        input: Array,  # noqa: A002 - the field's word
        output: Array,
        orders: Orders,
        objective: str,
        recursion_start: int,
        scoring_start: int,
        max_root_radius: float,
    ) -> None:
        self.input, self.output, self.orders = input, output, orders
        self.objective = objective
        self.samples = len(output)
        self.recursion_start = recursion_start
        self.scoring_start = scoring_start
        self.max_root_radius = max_root_radius
        padded = kernels.padded_length(self.samples, self.recursion_start)
        self._y = _padded(output, padded)
        self._u = _padded(input, padded)
        self._nc = max(orders.nc, kernels.MIN_NC)
        rows = orders.na + orders.nb + 2 * self._nc
        self._signs = np.ones(rows)
        self._signs[orders.na : orders.na + orders.nb + self._nc] = -1.0
        # Rows of the kernels' tables that hold a point: C is padded there, points are not.
        noise = orders.na + orders.nb + np.arange(orders.nc)
        self._rows = np.concatenate([np.arange(orders.na + orders.nb), noise, noise + self._nc])
        self._work = _Workspace(
            parameters=np.zeros((rows, kernels.LANES)),
            residuals=np.zeros((padded, kernels.LANES)),
            slope=np.zeros((padded + self._nc, kernels.LANES)),
            gradient=np.zeros((rows, kernels.LANES)),
            total=np.zeros((1, kernels.LANES)),
            corner=np.ones((1, kernels.LANES)),
        )
        scored = self._y[scoring_start : self.samples]
        self._scale = float(np.sum(np.abs(scored)) if objective == "absolute" else scored @ scored)
        self.scored_samples = self.samples - scoring_start
        self._state_weight = STATE_WEIGHT * 100.0 / self._scale
        if objective == "absolute":  # a square in the unit of an absolute value
            self._state_weight /= self._scale / self.scored_samples

    def of_orders(self, orders: Orders) -> PredictionErrorProblem:
        """The same problem for other orders that have residuals from ``recursion_start`` on."""
        return PredictionErrorProblem(
            self.input,
            self.output,
            orders,
            self.objective,
            self.recursion_start,
            self.scoring_start,
            self.max_root_radius,
        )

    @property
    def dimension(self) -> int:
        """Length of a point: n = na + nb + nc parameters and nc noise states."""
        return self.orders.parameters + self.orders.nc

    def values(self, points: Array) -> Array:
        """Objective of each row of an (M, n) population, in percent; infeasible rows are inf.

        The weak square of the noise state is part of it.
        """
        values = np.full(len(points), np.inf)
        total = kernels.absolute_sum if self.objective == "absolute" else kernels.square_sum
        for rows in self._passes(self.feasible(points)):
            self._run_residuals(points[rows])
            work = self._work
            total(work.residuals, self.scoring_start, self.samples, work.total)
            values[rows] = 100.0 * work.total[0, : len(rows)] / self._scale
        values += self._state_weight * _square_sums(self._states(points))
        values[~np.isfinite(values)] = np.inf
        return values

    def values_and_gradients(
        self, points: Array, corners: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row and its gradient; infeasible rows are inf and 0.

        ``corners`` (M,), in the unit of the output, round the corner of the absolute value,
        ``sqrt(e**2 + corner**2)``; the quadratic objective does not use them.  ``barriers``
        (M,), in percent, weigh a barrier that grows towards the edge of the stability region
        (:func:`evopem.estimation.kernels.stability_barrier` of A and of C), so that a descent
        is led along the edge instead of being stuck at it.
        """
        values = np.full(len(points), np.inf)
        gradients = np.zeros(points.shape)
        feasible = self.feasible(points)
        o, work = self.orders, self._work
        factor = 100.0 / self._scale
        for rows in self._passes(feasible):
            self._run_residuals(points[rows])
            span = (work.residuals, self.scoring_start, self.samples)
            if self.objective == "absolute":
                work.corner[0, : len(rows)] = corners[rows]
                kernels.smoothed_absolute_slope(*span, work.corner, work.slope, work.total)
            else:
                kernels.square_slope(*span, work.slope, work.total)
            kernels.adjoint_gradient(
                self._y,
                self._u,
                work.residuals,
                o.na,
                o.nb,
                self._nc,
                o.nk,
                self.recursion_start,
                work.parameters,
                work.slope,
                work.gradient,
            )
            values[rows] = factor * work.total[0, : len(rows)]
            gradient = (self._signs[:, None] * work.gradient)[self._rows, : len(rows)]
            gradients[rows] = factor * gradient.T
        inside = np.flatnonzero(feasible)
        for part in self._polynomials():
            barrier, slope, _ = self._barrier(points[inside], part, with_curvature=False)
            values[inside] += barriers[inside] * barrier
            gradients[inside, part] += barriers[inside, None] * slope
        states = self._states(points)
        values += self._state_weight * _square_sums(states)
        self._states(gradients)[:] += 2.0 * self._state_weight * states
        bad = ~(np.isfinite(values) & np.isfinite(gradients).all(axis=1))
        values[bad] = np.inf
        gradients[bad] = 0.0
        return values, gradients

    def curvatures(self, points: Array, corners: Array, barriers: Array) -> Array:
        """Gauss-Newton approximation of the Hessian of what rows of a descent minimise, (M, n, n).

        For the absolute objective the mean second derivative of the loss (twice the density of
        the residuals at zero) scales the same matrix.
        """
        o, n = self.orders, self.dimension
        matrices = np.zeros((len(points), n, n))
        if not len(points):
            return matrices
        rows_padded = len(self._signs)
        table = np.empty((5, len(self._y), kernels.LANES))  # the kernel writes every row
        matrix = np.zeros((rows_padded, rows_padded, kernels.LANES))
        factor = 100.0 / self._scale
        for rows in self._passes(np.ones(len(points), dtype=bool)):
            self._run_residuals(points[rows])
            kernels.gauss_newton(
                self._y,
                self._u,
                self._work.residuals,
                o.na,
                o.nb,
                self._nc,
                o.nk,
                self.recursion_start,
                self.scoring_start,
                self.samples,
                self._work.parameters,
                table[0],
                table[1],
                table[2],
                table[3],
                table[4],
                matrix,
            )
            kept = matrix[np.ix_(self._rows, self._rows)][:, :, : len(rows)]
            upper = np.triu(np.moveaxis(kept, 2, 0))
            symmetric = upper + np.swapaxes(np.triu(upper, 1), 1, 2)
            matrices[rows] = factor * self._mean_curvature(corners[rows])[:, None, None] * symmetric
        for part in self._polynomials():
            curvature = self._barrier(points, part, with_curvature=True)[2]
            matrices[:, part, part] += barriers[:, None, None] * curvature
        state = np.arange(o.parameters, n)
        matrices[:, state, state] += 2.0 * self._state_weight
        return matrices

    def mean_absolute_residuals(self, values: Array) -> Array:
        """Mean (absolute objective) or root mean square (quadratic) residual, from values."""
        total = values / 100.0 * self._scale / self.scored_samples
        return total if self.objective == "absolute" else np.sqrt(total)

    def residuals(self, point: Array) -> Array:
        """Residuals of one parameter vector, (N,); zero before ``recursion_start``."""
        self._run_residuals(point[None, :])
        return self._work.residuals[: self.samples, 0].copy()

    def feasible(self, points: Array) -> NDArray[np.bool_]:
        """Whether A and C of each row have all roots within ``max_root_radius``."""
        feasible = np.asarray(np.isfinite(points).all(axis=1))
        for part in self._polynomials():
            coefficients = np.ascontiguousarray(points[:, part])
            stable: NDArray[np.bool_] = kernels.schur_stable(coefficients, self.max_root_radius)
            feasible = np.logical_and(feasible, stable)
        return feasible

    def repair(self, points: Array) -> Array:
        """Move the roots of A and C of infeasible rows inside by reflection at the unit circle.

        Reflection of a root of C leaves the spectrum of the noise as it was (Söderström &
        Stoica 1989, section 6.2); roots in the margin go to its inner edge.
        """
        repaired = points.copy()
        inner = self.max_root_radius * (1.0 - 1e-6)
        for row in np.flatnonzero(~self.feasible(points)):
            point = np.where(np.isfinite(points[row]), points[row], 0.0)
            for part in self._polynomials():
                point[part] = reflect_into_disc(point[part], inner)
            repaired[row] = point
        return repaired

    def _states(self, points: Array) -> Array:
        return points[:, self.orders.parameters :]

    def _polynomials(self) -> tuple[slice, slice]:
        """Where the coefficients of A and of C stand in a point."""
        o = self.orders
        return slice(0, o.na), slice(o.na + o.nb, o.parameters)

    def _barrier(
        self, points: Array, part: slice, *, with_curvature: bool
    ) -> tuple[Array, Array, Array]:
        coefficients = np.ascontiguousarray(points[:, part])
        barrier: tuple[Array, Array, Array] = kernels.stability_barrier(
            coefficients, self.max_root_radius, with_curvature
        )
        return barrier

    def _passes(self, chosen: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
        """Chosen rows in groups of at most one SIMD pass each."""
        rows = np.flatnonzero(chosen)
        return [rows[i : i + kernels.LANES] for i in range(0, len(rows), kernels.LANES)]

    def _run_residuals(self, points: Array) -> None:
        o, work = self.orders, self._work
        work.parameters[:] = 0.0
        work.parameters[self._rows, : len(points)] = self._signs[self._rows, None] * points.T
        kernels.residuals(
            self._y,
            self._u,
            o.na,
            o.nb,
            self._nc,
            o.nk,
            self.recursion_start,
            work.parameters,
            work.residuals,
        )

    def _mean_curvature(self, corners: Array) -> Array:
        """Mean second derivative of the loss over the residuals of the last pass, (models,)."""
        if self.objective == "quadratic":
            return np.full(len(corners), 2.0)
        work = self._work
        span = (work.residuals, self.scoring_start, self.samples)
        kernels.absolute_sum(*span, work.total)
        # A kernel estimate of the density at zero, no narrower than the corner itself.
        width = DENSITY_BANDWIDTH * work.total / self.scored_samples
        width[0, : len(corners)] = np.maximum(width[0, : len(corners)], corners)
        kernels.smoothed_absolute_curvature(*span, width, work.total)
        return work.total[0, : len(corners)] / self.scored_samples


def _square_sums(rows: Array) -> Array:
    return np.einsum("ij,ij->i", rows, rows)


def _padded(signal: Array, length: int) -> Array:
    padded = np.zeros(length)
    padded[: len(signal)] = signal
    return padded
