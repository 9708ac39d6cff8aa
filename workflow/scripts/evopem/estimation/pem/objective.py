"""The prediction-error problem of one record and one model order, for whole populations at once.

A *point* is a parameter vector ``p = [a_1..a_na, b_0..b_(nb-1), c_1..c_nc]`` (chapter eq. 18)
followed by the noise state ``d_0..d_(nc-1)``: what the unknown noise before the first residual has
to do with the residuals after it.  Estimated along with p, it leaves no transient, however slow
the roots of C; a fixed zero would, and on a twice-differenced record, whose C has roots close to
the unit circle, that transient would decide between the orders.  A population is an (M, n + nc)
array.  Numerics only: no search lives here.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem import kernels
from evopem.estimation.pem.kernels.bfgs import State
from evopem.estimation.pem.losses import mean_residuals, slopes_of, total_loss
from evopem.estimation.pem.root_repair import repaired
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# What the square of a noise state weighs against that of a residual: a prior of ten standard
# deviations of the innovations.  Where C forgets its start before the first scored residual, a
# state of any size would fit a few residuals more, and the search would have no end.
STATE_WEIGHT = 1e-2
# Width of the kernel that estimates the density of the residuals at zero, in mean |e|.
DENSITY_BANDWIDTH = 0.3


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
        absolute = objective == "absolute"
        self._scale = total_loss(output[scoring_start:], objective)
        self.scored_samples = self.samples - scoring_start
        # A square in the unit of the loss.
        state_unit = self._scale / self.scored_samples if absolute else 1.0
        self._objective = kernels.Objective(
            absolute=absolute,
            factor=100.0 / self._scale,
            state_weight=STATE_WEIGHT * 100.0 / self._scale / state_unit,
            max_root_radius=max_root_radius,
        )

    @cached_property
    def _record(self) -> kernels.Record:
        """The padded record, a copy that takes the place of the given signals, made when needed."""
        padded = kernels.padded_length(self.samples, self.recursion_start)
        y, u = _padded(self.output, padded), _padded(self.input, padded)
        self.output, self.input = y[: self.samples], u[: self.samples]
        return kernels.Record(
            y=y,
            u=u,
            na=self.orders.na,
            nb=self.orders.single.nb,
            nc=self.orders.nc,
            nk=self.orders.single.nk,
            rows_c=max(self.orders.nc, kernels.MIN_NC),
            residual_start=self.recursion_start,
            loss_start=self.scoring_start,
            loss_stop=self.samples,
        )

    # Tables of eight numbers a sample, made when they are needed: a problem that is only scaled
    # needs none.
    @cached_property
    def _workspace(self) -> kernels.Workspace:
        return kernels.workspace_for(self._record)

    @cached_property
    def _lag_sums(self) -> kernels.LagSums:
        return kernels.lag_sums_for(self._record)

    def of_orders(self, orders: Orders) -> PredictionErrorProblem:
        """The same problem for other orders that have residuals from ``recursion_start`` on."""
        return self._with(orders, self.max_root_radius)

    def within_radius(self, radius: float) -> PredictionErrorProblem:
        """The same problem with another allowed radius of the roots."""
        return self._with(self.orders, radius)

    def _with(self, orders: Orders, max_root_radius: float) -> PredictionErrorProblem:
        return PredictionErrorProblem(
            self.input,
            self.output,
            orders,
            self.objective,
            self.recursion_start,
            self.scoring_start,
            max_root_radius,
        )

    def radius_of(self, name: str) -> float:  # noqa: ARG002 - as of other problems
        """Largest allowed radius of the roots of a polynomial, "a" or "c"."""
        return self.max_root_radius

    @property
    def dimension(self) -> int:
        """Length of a point: n = na + nb + nc parameters and nc noise states."""
        return self.orders.parameters + self.orders.nc

    def parts(self) -> dict[str, slice]:
        """Where the parts of a point stand: a, b, c and noise."""
        o = self.orders
        return {
            "a": slice(0, o.na),
            "b": slice(o.na, o.na + o.single.nb),
            "c": slice(o.na + o.single.nb, o.parameters),
            "noise": slice(o.parameters, self.dimension),
        }

    def values(self, points: Array) -> Array:
        """Objective of each row of an (M, n) population, in percent; infeasible rows are inf.

        The weak square of the noise state is part of it.
        """
        values: Array = kernels.values(
            self._record, self._objective, self._workspace, _rows(points)
        )
        return values

    def values_and_gradients(
        self, points: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row and its gradient; infeasible rows are inf and 0.

        ``smoothing`` (M,), in the unit of the output, is the width over which the absolute value
        is smoothed, ``sqrt(e**2 + smoothing**2)``; the quadratic objective does not use it.
        ``barriers`` (M,), in percent, are the weights of a barrier that grows towards the edge of
        the stability region (:func:`evopem.estimation.pem.kernels.stability_barriers` of A and of
        C), so that a descent moves along the edge instead of stopping at it.
        """
        return kernels.values_and_gradients_at(
            self._record, self._objective, self._workspace, _rows(points), smoothing, barriers
        )

    def advance_descents(
        self,
        smoothing: Array,
        barriers: Array,
        tolerance: float,
        max_iterations: int,
        state: State,
        trials: int,
        few: int,
    ) -> tuple[int, int]:
        """Trials of descents by :meth:`values_and_gradients`; see :func:`.batch_bfgs.descend_by`.

        Smoothing and barriers are those of the starts.
        """
        made: tuple[int, int] = kernels.advance_descents(
            self._record,
            self._objective,
            self._workspace,
            state,
            smoothing,
            barriers,
            tolerance,
            max_iterations,
            trials,
            few,
        )
        return made

    def curvatures(self, points: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton approximation of the Hessian of the smoothed objective, (M, n, n).

        For the absolute objective the mean second derivative of the loss (twice the density of
        the residuals at zero) scales the same matrix.
        """
        matrices: Array = kernels.gauss_newton_matrices(
            self._record,
            self._objective,
            self._workspace,
            self._lag_sums,
            DENSITY_BANDWIDTH,
            _rows(points),
            smoothing,
            barriers,
        )
        return matrices

    def mean_absolute_residuals(self, values: Array) -> Array:
        """Mean (absolute objective) or root mean square (quadratic) residual, from values."""
        return mean_residuals(values, self._scale, self.scored_samples, self.objective)

    def residuals(self, point: Array) -> Array:
        """Residuals of one parameter vector, (N,); zero before ``recursion_start``."""
        residuals: Array = kernels.residuals(self._record, np.ascontiguousarray(point))
        return residuals[: self.samples]

    def residuals_and_slopes(self, point: Array) -> tuple[Array, Array]:
        """Residuals, (N,), and the :func:`slopes_of` their losses."""
        residuals = self.residuals(point)
        return residuals, slopes_of(residuals, self.objective, self.scoring_start)

    def of_stretches(self, point: Array) -> list[tuple[PredictionErrorProblem, Array]]:
        """The errors of each stretch alone, and its point: one stretch here."""
        return [(self, point)]

    def feasible(self, points: Array) -> NDArray[np.bool_]:
        """Whether A and C of each row have all roots within ``max_root_radius``."""
        feasible: NDArray[np.bool_] = kernels.feasible_rows(
            self._record, self.max_root_radius, _rows(points)
        )
        return feasible

    def repair(self, points: Array) -> Array:
        """Move the roots of A and C of infeasible rows inside; see :func:`.repaired`."""
        return repaired(self, points, "ac")


def _rows(points: Array) -> Array:
    """A population as the kernels are compiled for: rows one after the other in memory."""
    return np.ascontiguousarray(points)


def _padded(signal: Array, length: int) -> Array:
    """A signal with zeros up to a length, and beyond it some that a kernel reads in vain."""
    padded = np.zeros(length + kernels.LANES)
    padded[: len(signal)] = signal
    return padded[:length]
