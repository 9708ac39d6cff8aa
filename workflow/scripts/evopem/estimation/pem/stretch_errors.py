"""The prediction-error problem of several stretches with one model: shared coefficients.

A point is ``[a, b, c, d, f]``, one level for each recording, the plant state of each stretch and
the noise state of each stretch.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import ScoringWindow
from evopem.estimation.pem.losses import mean_residuals, total_loss
from evopem.estimation.pem.polynomial_objective import PolynomialErrors, consecutive
from evopem.estimation.pem.root_repair import repaired
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Segment

Array = NDArray[np.float64]


class StretchErrors:
    """Objective, gradient and curvature over several stretches.

    It answers what :class:`evopem.estimation.pem.polynomial_objective.PolynomialErrors` answers,
    so that the same descents and the same search serve both.

    Parameters
    ----------
    stretches : sequence of Segment
        Those too short for the orders are left out.
    orders : Orders
    objective : {"absolute", "quadratic"}
    plant_radius, noise_radius : float
        Largest allowed radius of the roots of A and F, and of those of C and D.
    level : bool
        Whether a constant is estimated for each recording.
    window : ScoringWindow, optional
        First residual of each stretch and first one that counts; by default the first whose past is
        measured.

    Raises
    ------
    ValueError
        When no stretch is long enough for the orders.
    """

    loss_start = 0

    def __init__(
        self,
        stretches: Sequence[Segment],
        orders: Orders,
        objective: str,
        plant_radius: float,
        noise_radius: float,
        level: bool,
        window: ScoringWindow | None = None,
    ) -> None:
        self.window = window or ScoringWindow(orders.first_residual, orders.first_residual)
        first = self.window.loss_start
        needed = first + orders.single.nf + orders.noise_states
        self.stretches = tuple(each for each in stretches if each.samples > needed)
        if not self.stretches:
            raise ValueError(f"no stretch has the {needed + 1} samples that {orders} needs")
        self.orders, self.objective, self.level = orders, objective, level
        self.plant_radius, self.noise_radius = plant_radius, noise_radius
        longest = max(self.stretches, key=lambda each: each.samples)
        self.input, self.output, self.samples = longest.input, longest.output, longest.samples
        self._errors = [
            PolynomialErrors(
                np.ascontiguousarray(each.input),
                np.ascontiguousarray(each.output),
                orders,
                objective,
                self.window.residual_start,
                first,
                plant_radius,
                noise_radius,
                level,
            )
            for each in self.stretches
        ]
        self._scales = np.array([total_loss(e.output[first:], objective) for e in self._errors])
        self._scales = np.maximum(self._scales, np.finfo(float).tiny)
        self._weights = self._scales / np.sum(self._scales)
        self.scored_samples = sum(e.scored_samples for e in self._errors)
        self._positions = self._points_of_stretches()

    @property
    def signals(self) -> tuple[Array, Array]:
        """All inputs and all outputs, of one stretch after the other."""
        inputs = np.concatenate([each.input for each in self.stretches])
        return inputs, np.concatenate([each.output for each in self.stretches])

    def scaled(self, input_scale: float, output_scale: float) -> StretchErrors:
        """The same problem with divided signals."""
        stretches = [
            Segment(each.input / input_scale, each.output / output_scale, each.recording)
            for each in self.stretches
        ]
        return StretchErrors(
            *(stretches, self.orders, self.objective, self.plant_radius, self.noise_radius),
            self.level,
            self.window,
        )

    def within_radius(self, radius: float) -> StretchErrors:
        """The same problem with another allowed radius of all roots."""
        return StretchErrors(
            *(self.stretches, self.orders, self.objective, radius, radius, self.level), self.window
        )

    def radius_of(self, name: str) -> float:
        """Largest allowed radius of the roots of a polynomial, "a", "c", "d" or "f"."""
        return self.plant_radius if name in "af" else self.noise_radius

    @property
    def recordings(self) -> tuple[int, ...]:
        """Numbers of the recordings, in the order of their levels."""
        return tuple(dict.fromkeys(each.recording for each in self.stretches))

    @property
    def parameters(self) -> int:
        """Number of parameters: coefficients and levels, without the states."""
        return self.orders.parameters + (len(self.recordings) if self.level else 0)

    @property
    def dimension(self) -> int:
        """Length of a point."""
        o = self.orders
        return self.parameters + len(self.stretches) * (o.single.nf + o.noise_states)

    def parts(self) -> dict[str, slice]:
        """Where the parts of a point stand: a, b, c, d, f, level, plant and noise."""
        o, count = self.orders, len(self.stretches)
        lengths = {"a": o.na, "b": o.single.nb, "c": o.nc, "d": o.nd, "f": o.single.nf}
        lengths["level"] = len(self.recordings) if self.level else 0
        lengths |= {"plant": count * o.single.nf, "noise": count * o.noise_states}
        return consecutive(lengths)

    def _points_of_stretches(self) -> list[NDArray[np.intp]]:
        """Where the point of each stretch alone stands in the point of all."""
        parts, o = self.parts(), self.orders
        found = []
        for number, stretch in enumerate(self.stretches):
            level = [parts["level"].start + self.recordings.index(stretch.recording)]
            plant, noise = parts["plant"].start, parts["noise"].start
            found.append(
                np.concatenate(
                    [
                        np.arange(o.parameters),
                        level if self.level else [],
                        np.arange(plant + number * o.single.nf, plant + (number + 1) * o.single.nf),
                        np.arange(
                            noise + number * o.noise_states, noise + (number + 1) * o.noise_states
                        ),
                    ]
                ).astype(np.intp)
            )
        return found

    def values(self, points: Array) -> Array:
        """Objective of each row of an (M, n) population, in percent; infeasible rows are inf."""
        total = np.zeros(len(points))
        for errors, at, weight in zip(self._errors, self._positions, self._weights, strict=True):
            total += weight * errors.values(points[:, at])
        return total

    def values_and_gradients(
        self, points: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row and its gradient; infeasible rows are inf and 0."""
        total, gradients = np.zeros(len(points)), np.zeros(points.shape)
        for errors, at, weight in zip(self._errors, self._positions, self._weights, strict=True):
            value, gradient = errors.values_and_gradients(points[:, at], smoothing, barriers)
            total += weight * value
            gradients[:, at] += weight * gradient
        return total, gradients

    def curvatures(self, points: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton approximation of the Hessian of the smoothed objective, (M, n, n)."""
        n = points.shape[1]
        matrices = np.zeros((len(points), n, n))
        for errors, at, weight in zip(self._errors, self._positions, self._weights, strict=True):
            matrix = errors.curvatures(points[:, at], smoothing, barriers)
            matrices[:, at[:, None], at] += weight * matrix
        return matrices

    def mean_absolute_residuals(self, values: Array) -> Array:
        """Mean (absolute objective) or root mean square (quadratic) residual, from values."""
        total = float(np.sum(self._scales))
        return mean_residuals(values, total, self.scored_samples, self.objective)

    def residuals(self, point: Array) -> Array:
        """Residuals of one point that count, of all stretches one after the other."""
        return np.concatenate(self.residuals_of_stretches(point))

    def residuals_of_stretches(self, point: Array) -> list[Array]:
        """Residuals of one point that count, stretch by stretch."""
        return [
            errors.residuals(own)[errors.loss_start :] for errors, own in self.of_stretches(point)
        ]

    def of_stretches(self, point: Array) -> list[tuple[PolynomialErrors, Array]]:
        """The errors of each stretch alone, and its point."""
        return [(e, point[at]) for e, at in zip(self._errors, self._positions, strict=True)]

    def residual_counts(self) -> list[int]:
        """Number of residuals that count in each stretch."""
        return [errors.scored_samples for errors in self._errors]

    def scored_outputs(self) -> Array:
        """The outputs of the residuals that count, of all stretches one after the other."""
        return np.concatenate([errors.output[errors.loss_start :] for errors in self._errors])

    def scored_inputs(self) -> Array:
        """The inputs of the residuals that count."""
        return np.concatenate([errors.input[errors.loss_start :] for errors in self._errors])

    def completed_by_states(self, model: PolynomialModel) -> Array:
        """The point of a model, with the levels and states of least squared residuals.

        Residuals are linear in these.
        """
        point, parts = np.zeros(self.dimension), self.parts()
        point[: self.orders.parameters] = model.parameters
        linear = slice(parts["level"].start, None)
        columns = self.jacobian(point)[:, linear]
        if columns.shape[1]:
            point[linear] = np.linalg.lstsq(columns, -self.residuals(point), rcond=1e-10)[0]
        return point

    def jacobian(self, point: Array) -> Array:
        """Derivatives of the residuals that count by a point."""
        return np.concatenate(list(self.jacobian_blocks(point)))

    def jacobian_blocks(self, point: Array) -> Iterator[Array]:
        """Its rows in consecutive blocks, which long records need."""
        for errors, at in zip(self._errors, self._positions, strict=True):
            for own in errors.jacobian_blocks(point[at]):
                block = np.zeros((len(own), self.dimension))
                block[:, at] = own
                yield block

    def feasible(self, points: Array) -> NDArray[np.bool_]:
        """Whether all roots of A, C, D and F of each row lie within their radii."""
        return self._errors[0].feasible(points[:, self._positions[0]]) & np.all(
            np.isfinite(points), axis=1
        )

    def repair(self, points: Array) -> Array:
        """Move the roots of infeasible rows inside; see :func:`.repaired`."""
        return repaired(self, points, "acdf")
