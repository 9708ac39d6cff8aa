"""The problem as the memetic search sees it, of squares and of absolute errors."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import Objective
from evopem.estimation import damped_descent
from evopem.estimation.damped_descent import Optimum, Places, descend
from evopem.estimation.pem.kernels.bfgs import Descent
from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.point_model import PointModel, ScaledModel, parameter_covariance
from evopem.estimation.state_space.sections import inside, largest_radius, normalised, rescaled
from evopem.estimation.state_space.starting_points import from_poles, random_poles
from evopem.models.parameter_covariance import ParameterCovariance

# Steps and tolerance of a descent of a search, and of its last one.
STEPS, TOLERANCE = 100, 1e-7
POLISH_STEPS, POLISH_TOLERANCE = 1000, 1e-11
# Poles of offspring beyond the radius are moved so far inside it: descents are free to move there.
INSIDE = 1e-6


class ErrorProblem:
    """An objective of errors of the scaled recording, and descents to its optima.

    ``power`` weighs absolute errors of outputs by their power, any other weighting by their noise.
    """

    def __init__(self, plain: StateSpaceErrors, objective: Objective) -> None:
        self.plain, self.objective = plain, objective
        self.weighing, self.sizes = plain.weighing, plain.data.absolute_sizes
        self.descended_in: Any = self  # as damped_descent asks of a problem of the objective

    def percent(self, errors: Array) -> float:
        """Objective of errors, (N, l), in percent."""
        if self.objective == "quadratic":
            return self.in_percent(self.plain.criterion(errors.T @ errors / len(errors)))
        criterion = damped_descent.absolute_criterion(errors / self.sizes, self.weighing)
        return self.in_percent(criterion)

    def in_percent(self, criterion: float) -> float:
        """A criterion in percent of the size of the outputs, y less its mean with a level."""
        if self.objective == "quadratic":
            return self.plain.percent(criterion)
        rounding = damped_descent.ROUNDING if np.isfinite(criterion) else 0.0
        return 100.0 * (float(np.exp(criterion)) - rounding)

    def optimum(
        self,
        point: Array,
        steps: int = STEPS,
        tolerance: float = TOLERANCE,
        width: float = damped_descent.SEARCH_WIDTH,
    ) -> Optimum:
        """The end of a descent; of absolute errors with a last width, or to the last digits."""
        if self.objective == "quadratic":
            return descend(self.descended_in, point, steps, tolerance)
        if tolerance >= TOLERANCE:
            return damped_descent.descend_absolute(self.descended_in, point, width)
        return damped_descent.polish_absolute(self.descended_in, point)


class StateSpaceProblem(ErrorProblem):
    """Search problem of one recording, order and form; see :class:`.Problem`."""

    descended = 1  # quadratic optima of an order that the search over orders goes on from
    completing = 0  # evaluations that the point of some coordinates takes
    grams = 1  # Gram matrices of one set of normal equations

    def __init__(self, plain: StateSpaceErrors, objective: Objective = "quadratic") -> None:
        super().__init__(plain, objective)
        self.parameters, self.dimension = plain.parameters, plain.layout.dimension
        self.starts: Array | None = None  # that the first population holds
        if objective == "quadratic":
            self.descended_in = plain

    def nearest(
        self, coordinates: list[Array], width: float = damped_descent.SEARCH_WIDTH
    ) -> Descent:
        """Optima next to those of the quadratic objective, and the evaluations.

        Of absolute errors descents from them, with a last width.
        """
        completed = [self.completed(quadratic) for quadratic in coordinates]
        points = np.array(completed).reshape(-1, self.dimension)
        if self.objective == "quadratic":
            return Descent(points, self.values(points), np.ones(len(points), dtype=bool), 0)
        reached = self.descents(points, STEPS, TOLERANCE, width)
        return replace(reached, evaluations=reached.evaluations + len(points))

    def completed(self, coordinates: Array) -> Array:
        """The point of some coordinates."""
        return coordinates

    def projection(self, point: Array) -> Projection:
        """States, linear coefficients and errors of a point, in units of the scaled recording."""
        return self.plain.projection(point)

    def stable(self, projection: Projection) -> bool:
        """Whether a descent may end there."""
        return self.plain.stable(projection)

    def scaled(self, point: Array) -> ScaledModel:
        """The model of a point."""
        return PointModel(self.plain, self.projection(point))

    def covariance(self, point: Array) -> ParameterCovariance | None:
        """Covariance of the entries; None where no density of absolute errors is known."""
        return parameter_covariance(self.plain, self.projection(point), self.objective)

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population, and the evaluations that it took; the first one holds the estimates."""
        if self.starts is None:
            return self.random(count, generator), count
        more = max(count // 3, 1, count - len(self.starts))
        points = np.vstack([self.starts, self.random(more, generator)])
        self.starts = None
        best = np.argsort(self.values(points), kind="stable")[:count]
        return points[best], 2 * len(points)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random poles, whose inputs fit the recording."""
        plain = self.plain
        poles = (random_poles(plain.order, generator) for _ in range(count))
        return np.array([self.completed(from_poles(plain, drawn)) for drawn in poles])

    def repair(self, points: Array) -> Array:
        """Move poles beyond the radius to it."""
        limit = self.plain.section_radius * (1.0 - INSIDE)
        return np.array([inside(self.plain.layout, point, limit) for point in points])

    def values(self, points: Array) -> Array:
        """Objective of each row in percent, infinite where it is not feasible, (M,)."""
        return np.array([self._value(point) for point in points])

    def _value(self, point: Array) -> float:
        radius = largest_radius(self.plain.layout, point)
        if not (np.isfinite(point).all() and radius <= self.plain.section_radius):
            return float("inf")
        projection = self.projection(point)
        return self.percent(projection.errors) if self.stable(projection) else float("inf")

    def descend(self, points: Array) -> Descent:
        """Descents from each row."""
        return self.descents(points, STEPS, TOLERANCE)

    def polish(self, points: Array) -> Descent:
        """Descents from each row to the last digits."""
        return self.descents(points, POLISH_STEPS, POLISH_TOLERANCE)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring with each section, ordered by angle, from one of two parents, completed."""
        layout = self.plain.layout
        pairs = generator.integers(len(parents), size=(2, count))
        from_first = generator.random((count, layout.sections)) < 0.5
        offspring = parents[pairs[1], : layout.dimension]
        for child, first, chosen in zip(offspring, parents[pairs[0]], from_first, strict=True):
            layout.rows(child)[chosen] = layout.rows(first)[chosen]
        completed = [self.completed(normalised(layout, child)) for child in offspring]
        return np.array(completed), count * self.completing

    def descents(
        self,
        points: Array,
        steps: int,
        tolerance: float,
        width: float = damped_descent.SEARCH_WIDTH,
    ) -> Descent:
        """Descents from each row, as :meth:`optimum`."""
        optima = [self.optimum(point, steps, tolerance, width) for point in points]
        return Descent(
            points=np.array([optimum.point for optimum in optima]).reshape(points.shape),
            values=np.array([self.in_percent(optimum.value) for optimum in optima]),
            converged=np.array([optimum.converged for optimum in optima], dtype=bool),
            evaluations=sum(optimum.evaluations for optimum in optima),
        )


class AbsoluteStateSpaceProblem(StateSpaceProblem):
    """The same of absolute errors: a point holds coordinates, then C, D and constants by output.

    Absolute errors of several outputs have no common linear solution, so nothing is eliminated.
    """

    descended, completing = 3, 1

    def __init__(self, plain: StateSpaceErrors) -> None:
        super().__init__(plain, "absolute")
        self.grams = len(self.sizes)
        self._regressors = plain.order + sum(block.shape[1] for block in plain.direct)
        self.dimension = plain.layout.dimension + self._regressors * len(self.sizes)
        self._latest: tuple[Array, Projection] | None = None

    def projection(self, point: Array) -> Projection:
        """States and errors of a point, in units of the scaled recording."""
        if self._latest is None or not np.array_equal(self._latest[0], point):
            coordinates, linear = np.split(point, [self.plain.layout.dimension])
            linear = linear.reshape(len(self.sizes), self._regressors).T
            self._latest = point.copy(), self.plain.with_linear(coordinates, linear)
        return self._latest[1]

    def jacobians(self, point: Array) -> Iterator[tuple[Array, Places]]:
        """Derivatives of the errors of each output by its part of a point."""
        projection = self.projection(point)
        signals = self.plain.signals.derivatives(projection.sections, projection.states)
        for k in range(len(self.sizes)):
            columns, places = self.plain.jacobian(projection, signals, k)
            yield -columns, places

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step within the radius; C follows the scale of its second states."""
        layout, count = self.plain.layout, self.plain.layout.dimension
        after = point + step
        after[:count] = self.plain.moved(point[:count], step[:count])
        of_outputs = after[count:].reshape(len(self.sizes), self._regressors)
        of_outputs[:, 1 : layout.order : 2] *= rescaled(layout, point, after)[: layout.pairs]
        return after

    def repair(self, points: Array) -> Array:
        """Move poles beyond the radius to it."""
        return np.array([self.moved(point, np.zeros_like(point)) for point in points])

    def completed(self, coordinates: Array) -> Array:
        """The point of some coordinates, C, D and constants of nearly the least absolute errors."""
        if not np.isfinite(coordinates).all():
            return np.full(self.dimension, np.nan)
        projection = self.plain.projection(coordinates)
        along = damped_descent.linear_coefficients(projection.basis, self.plain.data.outputs)
        triangle = projection.basis.T @ projection.regressors
        linear = np.linalg.lstsq(triangle, along, rcond=None)[0]
        return np.concatenate([coordinates, linear.T.ravel()])
