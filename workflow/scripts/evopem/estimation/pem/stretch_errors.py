"""The prediction-error problem of several stretches with one model: shared coefficients."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import ScoringWindow
from evopem.errors import NoModelError
from evopem.estimation.pem.losses import mean_residuals, total_loss
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.pem.polynomial_points import Places, PolynomialPoints
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Segment

Array = NDArray[np.float64]


class StretchErrors(PolynomialPoints):
    """Objective, gradient and curvature over several stretches.

    It answers what :class:`.polynomial_objective.PolynomialErrors` answers, so that the same
    descents and the same search serve both.

    ``stretches``: with one output; those too short for the orders are left out.  ``level``: whether
    a constant is estimated for each recording.  ``window``: first residual of each stretch and
    first one that counts; by default the first whose past is measured.  ValueError when no stretch
    is long enough for the orders.
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
        needed = first + sum(orders.nf) + orders.noise_states
        self.stretches = tuple(each for each in stretches if each.samples > needed)
        if not self.stretches:
            raise NoModelError(f"no stretch has the {needed + 1} samples that {orders} needs")
        self.orders, self.objective = orders, objective
        self.plant_radius, self.noise_radius = plant_radius, noise_radius
        # Numbers of the recordings, in the order of their levels.
        self.recordings = tuple(dict.fromkeys(each.recording for each in self.stretches))
        self.levels = len(self.recordings) if level else 0
        self.stretches_count = len(self.stretches)
        longest = max(self.stretches, key=lambda each: each.samples)
        self.inputs, self.output, self.samples = longest.inputs, longest.output, longest.samples
        self._errors = [
            PolynomialErrors(
                np.ascontiguousarray(each.inputs),
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
        """All inputs, (N, m), and all outputs, of one stretch after the other."""
        inputs = np.concatenate([each.inputs for each in self.stretches])
        return inputs, np.concatenate([each.output for each in self.stretches])

    def scaled(self, input_scales: Array, output_scale: float) -> StretchErrors:
        """The same problem with divided signals; one scale for each input."""
        stretches = [
            Segment(each.inputs / input_scales, each.outputs / output_scale, each.recording)
            for each in self.stretches
        ]
        return self._with(stretches=stretches)

    def of_orders(self, orders: Orders) -> StretchErrors:
        """The problem of other orders, whose residuals may have to start later."""
        return self._with(orders=orders, window=self.window.from_first(orders.first_residual))

    def within_radius(self, radius: float, noise_radius: float | None = None) -> StretchErrors:
        """The same problem with another allowed radius of all roots, or of C and D another one."""
        return self._with(plant_radius=radius, noise_radius=noise_radius or radius)

    def _with(self, **changes: object) -> StretchErrors:
        given = {
            "stretches": self.stretches,
            "orders": self.orders,
            "objective": self.objective,
            "plant_radius": self.plant_radius,
            "noise_radius": self.noise_radius,
            "level": self.level,
            "window": self.window,
        }
        return StretchErrors(**(given | changes))  # type: ignore[arg-type]

    def _points_of_stretches(self) -> list[Places]:
        """Where the point of each stretch alone stands in the point of all."""
        parts, o = self.parts(), self.orders
        nf, states, found = sum(o.nf), o.noise_states, []
        for number, stretch in enumerate(self.stretches):
            level = [parts["level"].start + self.recordings.index(stretch.recording)]
            plant = parts["plant"].start + number * nf
            noise = parts["noise"].start + number * states
            own = [np.arange(o.parameters), np.array(level if self.level else [])]
            own += [np.arange(plant, plant + nf), np.arange(noise, noise + states)]
            found.append(np.concatenate(own).astype(np.intp))
        return found

    def places(self) -> list[tuple[PolynomialErrors, Places]]:
        """The errors of each stretch alone, and where its point stands in the point of all."""
        return list(zip(self._errors, self._positions, strict=True))

    def of_stretches(self, point: Array) -> list[tuple[PolynomialErrors, Array]]:
        """The errors of each stretch alone, and its point."""
        return [(errors, point[at]) for errors, at in self.places()]

    @property
    def loss_factor(self) -> float:
        """What the objective multiplies the sum of losses by."""
        return 100.0 / float(np.sum(self._scales))

    def state_weights(self) -> Array:
        """Weights of the squares of a point's entries in the objective, (n,): of its states."""
        weights = np.zeros(self.dimension)
        for (errors, at), weight in zip(self.places(), self._weights, strict=True):
            weights[at] += weight * errors.state_weights()
        return weights

    def values(self, points: Array) -> Array:
        """Objective of each row of an (M, n) population, in percent; infeasible rows are inf."""
        total = np.zeros(len(points))
        for (errors, at), weight in zip(self.places(), self._weights, strict=True):
            total += weight * errors.values(points[:, at])
        return total

    def values_and_gradients(
        self, points: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row and its gradient; infeasible rows are inf and 0."""
        total, gradients = np.zeros(len(points)), np.zeros(points.shape)
        for (errors, at), weight in zip(self.places(), self._weights, strict=True):
            value, gradient = errors.values_and_gradients(points[:, at], smoothing, barriers)
            total += weight * value
            gradients[:, at] += weight * gradient
        return total, gradients

    def curvatures(self, points: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton approximation of the Hessian of the smoothed objective, (M, n, n)."""
        n = points.shape[1]
        matrices = np.zeros((len(points), n, n))
        for (errors, at), weight in zip(self.places(), self._weights, strict=True):
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

    def scored_outputs(self) -> Array:
        """The outputs of the residuals that count, of all stretches one after the other."""
        return np.concatenate([errors.output[errors.loss_start :] for errors in self._errors])

    def scored_inputs(self) -> Array:
        """The first input of the residuals that count."""
        return np.concatenate([errors.input[errors.loss_start :] for errors in self._errors])

    def completed_by_states(self, model: PolynomialModel) -> Array:
        """The point of a model, with the levels and states of least squared residuals."""
        point = np.zeros(self.dimension)
        point[: self.orders.parameters] = model.parameters
        linear = slice(self.orders.parameters, None)
        columns = self.jacobian(point)[:, linear]
        if columns.shape[1]:
            point[linear] = np.linalg.lstsq(columns, -self.residuals(point), rcond=1e-10)[0]
        return point

    def jacobian_blocks(self, point: Array) -> Iterator[Array]:
        """Consecutive rows of the derivatives of the residuals that count."""
        for errors, at in self.places():
            for own in errors.jacobian_blocks(point[at]):
                block = np.zeros((len(own), self.dimension))
                block[:, at] = own
                yield block

    def feasible(self, points: Array) -> NDArray[np.bool_]:
        """Whether all roots of A, C, D and F_i of each row lie within their radii."""
        return self._errors[0].feasible(points[:, self._positions[0]]) & np.all(
            np.isfinite(points), axis=1
        )


Errors = PolynomialErrors | StretchErrors
