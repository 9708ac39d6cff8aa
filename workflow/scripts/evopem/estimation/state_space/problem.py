"""The problem as the memetic search sees it, of squares and of absolute errors."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

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


class StateSpaceProblem:
    """Search problem of one recording, order and form; see :class:`.Problem`."""

    objective: Objective = "quadratic"
    descended = 1  # quadratic optima of an order that the search over orders goes on from

    def __init__(self, plain: StateSpaceErrors) -> None:
        self.plain, self.parameters = plain, plain.parameters
        self.grams = 1  # Gram matrices of one set of normal equations
        self.starts: Array | None = None  # that the first population holds

    def nearest(
        self,
        coordinates: list[Array],
        width: float = damped_descent.SEARCH_WIDTH,  # noqa: ARG002
    ) -> Descent:
        """Optima next to those of the quadratic objective; of absolute errors, of a last width."""
        points = np.array(coordinates).reshape(-1, self.plain.layout.dimension)
        return Descent(points, self.values(points), np.ones(len(points), dtype=bool), 0)

    def completed(self, coordinates: Array) -> Array:
        """The point of some coordinates."""
        return coordinates

    def projection(self, point: Array) -> Projection:
        """States, linear coefficients and errors of a point."""
        return self.plain.projection(point)

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
        values = self.values(points)
        best = np.argsort(values, kind="stable")[:count]
        return points[best], 2 * len(points)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random poles, whose inputs fit the recording."""
        order = self.plain.order
        return np.array(
            [from_poles(self.plain, random_poles(order, generator)) for _ in range(count)]
        )

    def repair(self, points: Array) -> Array:
        """Move poles beyond the radius to it."""
        limit = self.plain.section_radius * (1.0 - 1e-6)
        return np.array([inside(self.plain.layout, point, limit) for point in points])

    def values(self, points: Array) -> Array:
        """Criterion of each row in percent, (M,)."""
        return np.array([self.plain.percent(self.plain.value(point)) for point in points])

    def descend(self, points: Array) -> Descent:
        """Levenberg-Marquardt from each row."""
        return self.descents(points, STEPS, TOLERANCE)

    def polish(self, points: Array) -> Descent:
        """Levenberg-Marquardt from each row to the last digits."""
        return self.descents(points, POLISH_STEPS, POLISH_TOLERANCE)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring with each section, ordered by angle, from one of two parents."""
        layout = self.plain.layout
        pairs = generator.integers(len(parents), size=(2, count))
        from_first = generator.random((count, layout.sections)) < 0.5
        offspring = parents[pairs[1]].copy()
        for child, first, chosen in zip(offspring, parents[pairs[0]], from_first, strict=True):
            layout.rows(child)[chosen] = layout.rows(first)[chosen]
        return np.array([normalised(layout, child) for child in offspring]), 0

    def descents(self, points: Array, steps: int, tolerance: float) -> Descent:
        """Descents of at most some steps from each row."""
        optima = [descend(self.plain, point, steps, tolerance) for point in points]
        return _descent_of(optima, points, self.plain.percent)


class AbsoluteStateSpaceProblem(StateSpaceProblem):
    """The same of absolute errors: a point holds coordinates, then C, D and constants by output.

    Absolute errors of several outputs have no common linear solution, so nothing is eliminated.
    ``power`` weighs the outputs by their power, any other weighting by their noise.
    """

    objective: Objective = "absolute"
    descended = 3

    def __init__(self, plain: StateSpaceErrors) -> None:
        super().__init__(plain)
        self.sizes = plain.data.absolute_sizes
        self.grams = len(self.sizes)
        self.weighing, self.stable = plain.weighing, plain.stable
        self._regressors = plain.order + sum(block.shape[1] for block in plain.direct)
        self.dimension = plain.layout.dimension + self._regressors * len(self.sizes)
        self._latest: tuple[Array, Projection] | None = None

    def projection(self, point: Array) -> Projection:
        """States and errors of a point; the errors in the units of the scaled recording."""
        if self._latest is None or not np.array_equal(self._latest[0], point):
            linear = (
                point[self.plain.layout.dimension :].reshape(len(self.sizes), self._regressors).T
            )
            projection = self.plain.with_linear(self.coordinates(point), linear)
            self._latest = (point.copy(), projection)
        return self._latest[1]

    # What a descent of absolute errors asks for.

    def errors(self, point: Array) -> Array:
        """Errors over the mean absolute values of their outputs, (N, l)."""
        if not np.isfinite(point).all():
            return np.full(self.plain.data.outputs.shape, np.nan)
        return np.asarray(self.projection(point).errors / self.sizes)

    def jacobians(self, point: Array) -> Iterator[tuple[Array, Places]]:
        """Derivatives of the errors of each output by its part of a point."""
        projection = self.projection(point)
        signals = self.plain.signals.derivatives(projection.sections, projection.states)
        for k, size in enumerate(self.sizes):
            columns, places = self.plain.jacobian(projection, signals, k)
            yield columns / -size, places

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step within the radius; C follows the scale of its second states."""
        layout, count = self.plain.layout, self.plain.layout.dimension
        after = point + step
        after[:count] = self.plain.moved(point[:count], step[:count])
        of_outputs = after[count:].reshape(len(self.sizes), self._regressors)
        of_outputs[:, 1 : layout.order : 2] *= rescaled(layout, point, after)[: layout.pairs]
        return after

    # What the search asks for.

    def nearest(
        self, coordinates: list[Array], width: float = damped_descent.SEARCH_WIDTH
    ) -> Descent:
        """Optima next to those of the quadratic objective, and the evaluations."""
        starts = self._all_completed(coordinates)
        descended = self._descended(starts, width)
        return replace(descended, evaluations=descended.evaluations + len(starts))

    def completed(self, coordinates: Array) -> Array:
        """The point of some coordinates, C, D and constants of nearly the least absolute errors."""
        if not np.isfinite(coordinates).all():
            return np.full(self.dimension, np.nan)
        projection = self.plain.projection(coordinates)
        along = damped_descent.linear_coefficients(projection.basis, self.plain.data.outputs)
        triangle = projection.basis.T @ projection.regressors
        linear = np.linalg.lstsq(triangle, along, rcond=None)[0]
        return np.concatenate([coordinates, linear.T.ravel()])

    def coordinates(self, point: Array) -> Array:
        """The coordinates of a point."""
        return point[: self.plain.layout.dimension]

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random poles, whose inputs fit the recording."""
        return self._all_completed(super().random(count, generator))

    def repair(self, points: Array) -> Array:
        """Move poles beyond the radius to it."""
        return np.array([self.moved(point, np.zeros_like(point)) for point in points])

    def values(self, points: Array) -> Array:
        """Objective of each row in percent, infinite where it is not feasible, (M,)."""
        return np.array([self._value(point) for point in points])

    def _value(self, point: Array) -> float:
        plain = self.plain
        radius = largest_radius(plain.layout, self.coordinates(point))
        finite = np.isfinite(point).all() and radius <= plain.section_radius
        if not (finite and self.stable(self.projection(point))):
            return float("inf")
        criterion = damped_descent.absolute_criterion(self.errors(point), self.weighing)
        return percent_of_absolute(criterion)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring with each section from one of two parents, and C, D and levels anew."""
        coordinates = parents[:, : self.plain.layout.dimension]
        offspring, used = super().recombine(coordinates, count, generator)
        return self._all_completed(offspring), used + count

    def descents(self, points: Array, steps: int, tolerance: float) -> Descent:  # noqa: ARG002
        """Descents from each row, to the last digits where the tolerance asks for them."""
        if tolerance >= TOLERANCE:
            return self._descended(points, damped_descent.SEARCH_WIDTH)
        optima = [damped_descent.polish_absolute(self, point) for point in points]
        return _descent_of(optima, points, percent_of_absolute)

    def _descended(self, points: Array, last_width: float) -> Descent:
        optima = [damped_descent.descend_absolute(self, point, last_width) for point in points]
        return _descent_of(optima, points, percent_of_absolute)

    def _all_completed(self, coordinates: Sequence[Array] | Array) -> Array:
        completed = [self.completed(coordinate) for coordinate in coordinates]
        return np.array(completed).reshape(-1, self.dimension)


def percent_of_absolute(criterion: float) -> float:
    """A criterion in percent of the mean absolute outputs, y less its mean with a level."""
    rounding = damped_descent.ROUNDING if np.isfinite(criterion) else 0.0
    return 100.0 * (float(np.exp(criterion)) - rounding)


def _descent_of(
    optima: Sequence[Optimum], points: Array, percent: Callable[[float], float]
) -> Descent:
    """Descents from each row of points, their values in percent."""
    return Descent(
        points=np.array([optimum.point for optimum in optima]).reshape(points.shape),
        values=np.array([percent(optimum.value) for optimum in optima]),
        converged=np.array([optimum.converged for optimum in optima], dtype=bool),
        evaluations=sum(optimum.evaluations for optimum in optima),
    )
