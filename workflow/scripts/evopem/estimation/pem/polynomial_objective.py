"""The prediction-error problem of a general polynomial model, for whole populations at once.

A *point* is a parameter vector ``[a, b, c, d, f]``, the level where one is estimated, the plant
state (nf entries) and the noise state (``max(nc, nd)`` entries).  The states are what the unknown
past adds to the first equations of ``F x = -B u + g`` and ``C e = D v + s``; estimated along, they
leave no transient.  A population is an (M, n) array.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels import polynomial as kernels
from evopem.estimation.pem.losses import mean_residuals, slopes_of, total_loss
from evopem.estimation.pem.objective import DENSITY_BANDWIDTH, STATE_WEIGHT
from evopem.estimation.pem.root_repair import repaired
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# Weight of the square of a plant state against that of a residual.  It only bounds states that the
# residuals that count do not determine: a prior of a thousand standard deviations.
PLANT_STATE_WEIGHT = 1e-6


class PolynomialErrors:
    """Objective, gradient, curvature and feasibility of general polynomial models on one record.

    Parameters
    ----------
    input, output : (N,) arrays
        The record; not modified.
    orders : Orders
    objective : {"absolute", "quadratic"}
        ``absolute``: ``100 sum|e| / sum|y|``; ``quadratic``: ``100 sum e**2 / sum y**2``.
    residual_start : int
        First residual, at least ``orders.first_residual``.
    loss_start : int
        First residual that counts.
    plant_radius, noise_radius : float
        Largest allowed radius of the roots of A and F, and of those of C and D.
    level : bool
        Whether a constant is estimated: ``A y = (B/F) u + (C/D) e + level``.
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
        self.input, self.output, self.orders = input, output, orders
        self.objective = objective
        self.samples = len(output)
        self.residual_start, self.loss_start = residual_start, loss_start
        self.plant_radius, self.noise_radius = plant_radius, noise_radius
        self.level = level
        o = orders
        self._record = kernels.polynomial_record(
            output,
            input,
            (o.na, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk),
            level,
            residual_start,
            loss_start,
        )
        self._workspace = kernels.polynomial_workspace(self._record)
        absolute = objective == "absolute"
        self._scale = total_loss(output[loss_start:], objective)
        self.scored_samples = self.samples - loss_start
        # A square in the unit of the loss.
        state_unit = self._scale / self.scored_samples if absolute else 1.0
        factor = 100.0 / self._scale
        self._objective = kernels.PolynomialObjective(
            absolute=absolute,
            factor=factor,
            plant_state_weight=PLANT_STATE_WEIGHT * factor / state_unit,
            noise_state_weight=STATE_WEIGHT * factor / state_unit,
            plant_radius=plant_radius,
            noise_radius=noise_radius,
        )

    def of_orders(self, orders: Orders) -> PolynomialErrors:
        """The same problem for other orders that have residuals from ``residual_start`` on."""
        return self._with(orders=orders)

    def with_loss_start(self, loss_start: int) -> PolynomialErrors:
        """The same problem with another first residual that counts."""
        return self._with(loss_start=loss_start)

    def within_radius(self, radius: float) -> PolynomialErrors:
        """The same problem with another allowed radius of all roots."""
        return self._with(radius=radius)

    def _with(
        self,
        orders: Orders | None = None,
        loss_start: int | None = None,
        radius: float | None = None,
    ) -> PolynomialErrors:
        return PolynomialErrors(
            self.input,
            self.output,
            self.orders if orders is None else orders,
            self.objective,
            self.residual_start,
            self.loss_start if loss_start is None else loss_start,
            self.plant_radius if radius is None else radius,
            self.noise_radius if radius is None else radius,
            self.level,
        )

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

    def radius_of(self, name: str) -> float:
        """Largest allowed radius of the roots of a polynomial, "a", "c", "d" or "f"."""
        return self.plant_radius if name in "af" else self.noise_radius

    @property
    def dimension(self) -> int:
        """Length of a point: coefficients, level, plant state and noise state."""
        return self.parameters + self.orders.single.nf + self.orders.noise_states

    @property
    def parameters(self) -> int:
        """Number of parameters: coefficients and level, without the states."""
        return self.orders.parameters + int(self.level)

    def parts(self) -> dict[str, slice]:
        """Where the parts of a point stand: a, b, c, d, f, level, plant and noise."""
        o = self.orders
        lengths = {"a": o.na, "b": o.single.nb, "c": o.nc, "d": o.nd, "f": o.single.nf}
        lengths |= {"level": int(self.level), "plant": o.single.nf, "noise": o.noise_states}
        return consecutive(lengths)

    def values(self, points: Array) -> Array:
        """Objective of each row of an (M, n) population, in percent; infeasible rows are inf.

        The weak squares of the states are part of it.
        """
        values: Array = kernels.polynomial_values(
            self._record, self._objective, self._workspace, _rows(points)
        )
        return values

    def values_and_gradients(
        self, points: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row and its gradient; infeasible rows are inf and 0.

        ``smoothing`` (M,), in the unit of the output, is the width over which the absolute value
        is smoothed, ``sqrt(e**2 + smoothing**2)``.  ``barriers`` (M,), in percent, are the weights
        of a barrier that grows towards the edge of the stability region.
        """
        found: tuple[Array, Array] = kernels.polynomial_values_and_gradients(
            self._record, self._objective, self._workspace, _rows(points), smoothing, barriers
        )
        return found

    def curvatures(self, points: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton approximation of the Hessian of the smoothed objective, (M, n, n).

        For the absolute objective the mean second derivative of the loss (twice the density of
        the residuals at zero) scales the same matrix.
        """
        matrices: Array = kernels.polynomial_gauss_newton_matrices(
            self._record,
            self._objective,
            self._workspace,
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
        found = kernels.polynomial_residuals(
            self._record, self._workspace, _rows(point[None, :]), np.zeros(1, dtype=np.intp)
        )
        residuals = np.zeros(self.samples)
        residuals[self.residual_start :] = found[0, : self.samples - self.residual_start]
        return residuals

    def jacobian(self, point: Array) -> Array:
        """Derivatives of the residuals that count by a point, (N - loss_start, n)."""
        jacobian: Array = kernels.polynomial_jacobian(
            self._record, self._workspace, _rows(point[None, :]), np.zeros(1, dtype=np.intp)
        )
        return jacobian

    def residuals_and_slopes(self, point: Array) -> tuple[Array, Array]:
        """Residuals, (N,), and the :func:`slopes_of` their losses."""
        residuals = self.residuals(point)
        return residuals, slopes_of(residuals, self.objective, self.loss_start)

    def of_stretches(self, point: Array) -> list[tuple[PolynomialErrors, Array]]:
        """The errors of each stretch alone, and its point: one stretch here."""
        return [(self, point)]

    def feasible(self, points: Array) -> NDArray[np.bool_]:
        """Whether all roots of A, C, D and F of each row lie within their radii."""
        feasible: NDArray[np.bool_] = kernels.feasible_polynomials(
            self._record, self._objective, _rows(points)
        )
        return feasible

    def repair(self, points: Array) -> Array:
        """Move the roots of infeasible rows inside; see :func:`.repaired`."""
        return repaired(self, points, "acdf")


def consecutive(lengths: Mapping[str, int]) -> dict[str, slice]:
    """Where parts of some lengths stand, one after the other."""
    parts, first = {}, 0
    for name, length in lengths.items():
        parts[name] = slice(first, first + length)
        first += length
    return parts


def _rows(points: Array) -> Array:
    """A population as the kernels are compiled for: rows one after the other in memory."""
    return np.ascontiguousarray(points)
