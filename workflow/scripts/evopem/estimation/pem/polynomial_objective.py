"""Prediction errors of a polynomial model on one stretch, for whole populations at once."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem import kernels
from evopem.estimation.pem.jacobian import jacobian_blocks
from evopem.estimation.pem.kernels.bfgs import State
from evopem.estimation.pem.losses import mean_residuals, slopes_of, total_loss
from evopem.estimation.pem.polynomial_points import Places, PolynomialPoints
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# What the square of a noise state weighs against that of a residual: a prior of ten standard
# deviations of the innovations.  Where C forgets its start before the first scored residual, a
# state of any size would fit a few residuals more, and the search would have no end.
STATE_WEIGHT = 1e-2
# Width of the kernel that estimates the density of the residuals at zero, in mean |e|.
DENSITY_BANDWIDTH = 0.3
# Weight of the square of a plant state against that of a residual.  It only bounds states that the
# residuals that count do not determine: a prior of a thousand standard deviations.
PLANT_STATE_WEIGHT = 1e-6


class PolynomialErrors(PolynomialPoints):
    """Objective, gradient, curvature and feasibility of polynomial models on one stretch.

    ``input`` (N,): not modified, like the output.  ``output`` (N,).  ``objective`` {"absolute",
    "quadratic"}: ``absolute``: ``100 sum|e| / sum|y|`` (chapter eq. 20-21, as ``100 - fit``);
    ``quadratic``: ``100 sum e**2 / sum y**2`` (eq. 22).  ``residual_start``: first residual, at
    least ``orders.first_residual``.  One number for all orders that are compared, so that a smaller
    model is a special case of a larger one.  ``loss_start``: first residual that counts.
    ``plant_radius``, ``noise_radius``: largest allowed radius of the roots of A and F, and of
    those of C and D.  ``level``: whether a constant is estimated:
    ``A y = (B/F) u + (C/D) e + level``.
    """

    def __init__(
        self,
        input: Array,  # noqa: A002 - the field's word
        output: Array,
        orders: Orders,
        objective: str,
        residual_start: int,
        loss_start: int,
        plant_radius: float,
        noise_radius: float,
        level: bool = False,
    ) -> None:
        self.samples = len(output)
        self.inputs = input.reshape(self.samples, -1)[:, : orders.inputs]  # (N, m)
        self.output, self.orders, self.objective = output, orders, objective
        self.residual_start, self.loss_start = residual_start, loss_start
        self.plant_radius, self.noise_radius = plant_radius, noise_radius
        self.levels = int(level)
        absolute = objective == "absolute"
        self._scale = total_loss(output[loss_start:], objective)
        self.scored_samples = self.samples - loss_start
        # A square in the unit of the loss.
        state_unit = self._scale / self.scored_samples if absolute else 1.0
        factor = 100.0 / self._scale
        self._objective = kernels.Objective(
            absolute=absolute,
            factor=factor,
            plant_state_weight=PLANT_STATE_WEIGHT * factor / state_unit,
            noise_state_weight=STATE_WEIGHT * factor / state_unit,
            plant_radius=plant_radius,
            noise_radius=noise_radius,
        )

    # Tables of eight numbers a sample, made when they are needed: a problem that is only scaled
    # needs none.
    @cached_property
    def _record(self) -> kernels.Record:
        o = self.orders
        return kernels.record_of(
            self.output,
            self.inputs,
            (o.na, o.nb, o.nc, o.nd, o.nf, o.nk),
            self.level,
            self.residual_start,
            self.loss_start,
        )

    @cached_property
    def _workspace(self) -> kernels.Workspace:
        return kernels.workspace_for(self._record)

    @cached_property
    def _lag_sums(self) -> kernels.LagSums:
        return kernels.lag_sums_for(self._record)

    @property
    def input(self) -> Array:
        """The first input, (N,); zeros without one."""
        return self.inputs[:, 0] if self.orders.inputs else np.zeros(self.samples)

    @property
    def signals(self) -> tuple[Array, Array]:
        """All inputs, (N, m), and the output."""
        return self.inputs, self.output

    def of_orders(self, orders: Orders) -> PolynomialErrors:
        """The problem of other orders, whose residuals may have to start later."""
        first = orders.first_residual
        return self._with(
            orders=orders,
            residual_start=max(self.residual_start, first),
            loss_start=max(self.loss_start, first),
        )

    def with_loss_start(self, loss_start: int) -> PolynomialErrors:
        """The same problem with another first residual that counts."""
        return self._with(loss_start=loss_start)

    def within_radius(self, radius: float, noise_radius: float | None = None) -> PolynomialErrors:
        """The same problem with another allowed radius of all roots, or of C and D another one."""
        return self._with(plant_radius=radius, noise_radius=noise_radius or radius)

    def scaled(self, input_scales: Array, output_scale: float) -> PolynomialErrors:
        """The same problem with divided signals; one scale for each input."""
        return self._with(input=self.inputs / input_scales, output=self.output / output_scale)

    def _with(self, **changes: Any) -> PolynomialErrors:
        given: dict[str, Any] = {
            "input": self.inputs,
            "output": self.output,
            "orders": self.orders,
            "objective": self.objective,
            "residual_start": self.residual_start,
            "loss_start": self.loss_start,
            "plant_radius": self.plant_radius,
            "noise_radius": self.noise_radius,
            "level": self.level,
        }
        return PolynomialErrors(**(given | changes))

    @property
    def loss_factor(self) -> float:
        """What the objective multiplies the sum of losses by."""
        return float(self._objective.factor)

    def state_weights(self) -> Array:
        """Weights of the squares of a point's entries in the objective, (n,): of its states."""
        weights, parts = np.zeros(self.dimension), self.parts()
        weights[parts["plant"]] = self._objective.plant_state_weight
        weights[parts["noise"]] = self._objective.noise_state_weight
        return weights

    def values(self, points: Array) -> Array:
        """Objective of each row of an (M, n) population, in percent; infeasible rows are inf.

        The weak squares of the states are part of it.
        """
        return kernels.values(self._record, self._objective, self._workspace, _rows(points))

    def values_and_gradients(
        self, points: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row and its gradient; infeasible rows are inf and 0.

        ``smoothing`` (M,), in the unit of the output, is the width over which the absolute value
        is smoothed, ``sqrt(e**2 + smoothing**2)``.  ``barriers`` (M,), in percent, are the weights
        of a barrier that grows towards the edge of the stability region.
        """
        return kernels.values_and_gradients(
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
            *(self._record, self._objective, self._workspace, state, smoothing, barriers),
            *(tolerance, max_iterations, trials, few),
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
        """Residuals of one point, (N,); zero before ``residual_start``."""
        residuals = np.zeros(self.samples)
        found = kernels.residuals(self._record, self._workspace, _rows(point))
        residuals[self.residual_start :] = found
        return residuals

    def jacobian_blocks(self, point: Array) -> Iterator[Array]:
        """Its rows in consecutive blocks, which long records need."""
        record, work = self._record, self._workspace
        e = kernels.residuals(record, work, _rows(point))
        rows = slice(record.history, record.history + len(e))
        xs = [
            work.x[i * record.rows :][rows, 0].copy() if nf else e
            for i, nf in enumerate(self.orders.nf)
        ]
        v = work.v[rows, 0].copy() if record.nd else e
        signals = (xs, v, e)
        missing = self.loss_start - self.residual_start
        for block in jacobian_blocks(
            self.orders, point, self.level, self.output, self.inputs, signals
        ):
            if len(block) > missing:
                yield block[missing:]
            missing = max(missing - len(block), 0)

    def residuals_and_slopes(self, point: Array) -> tuple[Array, Array]:
        """Residuals, (N,), and the :func:`slopes_of` their losses."""
        residuals = self.residuals(point)
        return residuals, slopes_of(residuals, self.objective, self.loss_start)

    def places(self) -> list[tuple[PolynomialErrors, Places]]:
        """The errors of each stretch alone, and where its point stands: one stretch here."""
        return [(self, np.arange(self.dimension))]

    def of_stretches(self, point: Array) -> list[tuple[PolynomialErrors, Array]]:
        """The errors of each stretch alone, and its point."""
        return [(self, point)]

    def feasible(self, points: Array) -> NDArray[np.bool_]:
        """Whether all roots of A, C, D and F of each row lie within their radii."""
        feasible: NDArray[np.bool_] = kernels.feasible_rows(
            self._record, self._objective, _rows(points)
        )
        return feasible


def _rows(points: Array) -> Array:
    """A population as the kernels are compiled for: rows one after the other in memory."""
    return np.ascontiguousarray(points)
