"""The sum of absolute errors of state-space models: C, D and levels are part of a point.

Absolute errors of several outputs have no common least-squares solution, so that nothing is
eliminated.  A point is that of :mod:`.errors`, followed by C, D and the constants of each output.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import Objective
from evopem.estimation.absolute_descent import (
    ROUNDING,
    SEARCH_WIDTH,
    SWEEP_WIDTH,
    Places,
    Weighing,
    criterion,
    descend,
    linear_coefficients,
    output_weights,
    polish,
)
from evopem.estimation.damped_descent import Optimum
from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.covariance import density_at_zero
from evopem.estimation.state_space.errors import EDGE, Projection, StateSpaceErrors
from evopem.estimation.state_space.point_model import parameter_covariance
from evopem.estimation.state_space.problem import TOLERANCE, StateSpaceProblem, descent_of
from evopem.estimation.state_space.sections import inside, largest_radius, moved, scale_of
from evopem.estimation.vector_autoregression import limited
from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]

# Quadratic optima of an order that are descended from in the search over orders.
DESCENDED = 3


class AbsoluteStateSpaceErrors:
    """Errors, Jacobians and feasibility of models whose C, D and levels are part of a point.

    Parameters
    ----------
    quadratic : StateSpaceErrors
        Recording, order, structure and radius; of its weightings ``power`` weighs the outputs by
        their power, and all others by their noise.

    Attributes
    ----------
    sizes : (l,) array
        Mean absolute values of the outputs, in the units of the scaled recording.
    """

    def __init__(self, quadratic: StateSpaceErrors) -> None:
        self.quadratic = quadratic
        self.weighing: Weighing = "power" if quadratic.weighting == "power" else "noise"
        outputs = quadratic.data.outputs
        self.sizes = np.mean(np.abs(outputs), axis=0)
        self.sizes[self.sizes == 0.0] = 1.0
        self._regressors = quadratic.order + sum(each.shape[1] for each in quadratic.direct)
        self._latest: tuple[Array, Projection] | None = None

    @property
    def dimension(self) -> int:
        """Length of a point."""
        return self.quadratic.dimension + self._regressors * len(self.sizes)

    def projection(self, point: Array) -> Projection:
        """States and errors of a point; the errors in the units of the scaled recording."""
        if self._latest is None or not np.array_equal(self._latest[0], point):
            count = self.quadratic.dimension
            linear = point[count:].reshape(len(self.sizes), self._regressors).T
            projection = self.quadratic.with_linear(point[:count], linear)
            self._latest = (point.copy(), projection)
        return self._latest[1]

    def errors(self, point: Array) -> Array:
        """Errors over the mean absolute values of their outputs, (N, l)."""
        if not np.isfinite(point).all():
            return np.full(self.quadratic.data.outputs.shape, np.nan)
        return np.asarray(self.projection(point).errors / self.sizes)

    def jacobians(self, point: Array) -> Iterator[tuple[Array, Places]]:
        """Derivatives of the errors of each output by its part of a point."""
        problem, projection = self.quadratic, self.projection(point)
        signals = problem.signals.derivatives(projection.sections, projection.states)
        own = np.arange(self._regressors)
        shared = np.arange(problem.dimension)
        for k, size in enumerate(self.sizes):
            by_coordinates = problem.derivatives.of_output(
                projection.sections, signals, projection.linear[: problem.order, k]
            )
            columns = np.column_stack([by_coordinates, projection.regressors]) / -size
            yield columns, np.concatenate([shared, problem.dimension + k * len(own) + own])

    def moved(self, point: Array, step: Array) -> Array:
        """A point after a step, with poles beyond the radius drawn in to it.

        The second state of a section follows its scale, and C follows that state.
        """
        problem, count = self.quadratic, self.quadratic.dimension
        after = point + step
        limit = problem.radius * (1.0 - EDGE)
        coordinates = moved(problem.layout, point[:count], step[:count])
        after[:count] = inside(problem.layout, coordinates, limit)
        pairs = problem.layout.pairs
        if pairs:
            deltas = [problem.layout.pair_rows(each[:count])[:, 1] for each in (point, after)]
            ratio = scale_of(deltas[1]) / scale_of(deltas[0])
            of_outputs = after[count:].reshape(len(self.sizes), self._regressors)
            of_outputs[:, 1 : 2 * pairs : 2] *= ratio
        return after

    def is_stable(self, point: Array) -> bool:
        """Whether A is stable as well."""
        return self.quadratic.stable(self.projection(point))

    def completed(self, coordinates: Array) -> Array:
        """A point with C, D and constants of nearly the least absolute errors."""
        if not np.isfinite(coordinates).all():
            return np.full(self.dimension, np.nan)
        projection = self.quadratic.projection(coordinates)
        along = linear_coefficients(projection.basis, self.quadratic.data.outputs)
        triangle = projection.basis.T @ projection.regressors
        linear = np.linalg.lstsq(triangle, along, rcond=None)[0]
        return np.concatenate([coordinates, linear.T.ravel()])

    def value(self, point: Array) -> float:
        """Percent of the mean absolute outputs; infinite where a point is not feasible."""
        if not np.isfinite(point).all():
            return float("inf")
        layout = self.quadratic.layout
        if largest_radius(layout, point[: self.quadratic.dimension]) > self.quadratic.radius:
            return float("inf")
        if not self.is_stable(point):
            return float("inf")
        return self.percent(criterion(self.errors(point), self.weighing))

    def percent(self, criterion: float) -> float:
        """A criterion in percent of the mean absolute outputs, y less its mean with a level."""
        return 100.0 * (float(np.exp(criterion)) - (ROUNDING if np.isfinite(criterion) else 0.0))

    def descents(self, points: Array, last_width: float | None = None) -> Descent:
        """Descents from each row of (m, n) points; without a last width to the last digits."""
        optima = [
            polish(self, point) if last_width is None else descend(self, point, last_width)
            for point in points
        ]
        return descent_of(optima, points, self.percent)


class AbsoluteStateSpaceProblem(StateSpaceProblem):
    """As :class:`.StateSpaceProblem`; C, D and levels are part of a point."""

    objective: Objective = "absolute"

    def __init__(self, errors: StateSpaceErrors) -> None:
        super().__init__(errors)
        self.grams = errors.data.outputs.shape[1]
        self._absolute = AbsoluteStateSpaceErrors(errors)

    def nearest(self, coordinates: list[Array]) -> tuple[Array, int]:
        """Optima next to those of the quadratic objective, (m, n), and the evaluations."""
        points = [self.completed(each) for each in coordinates]
        starts = np.array(points).reshape(-1, self._absolute.dimension)
        reached = self._absolute.descents(starts, SEARCH_WIDTH)
        return reached.points, reached.evaluations + len(points)

    def lowest_of(self, optima: list[Optimum]) -> tuple[Array, float, int]:
        """The lowest optimum next to those of the quadratic objective, its value, evaluations."""
        points = np.array([self.completed(each.point) for each in optima[:DESCENDED]])
        reached = self._absolute.descents(points, SWEEP_WIDTH)
        lowest = int(np.argmin(reached.values))
        return reached.points[lowest], float(reached.values[lowest]), reached.evaluations

    def completed(self, coordinates: Array) -> Array:
        """The point of some coordinates, with nearly the best C, D and levels."""
        return self._absolute.completed(coordinates)

    def coordinates(self, point: Array) -> Array:
        """The coordinates of a point."""
        return point[: self.errors.dimension]

    def projection(self, point: Array) -> Projection:
        """States, linear coefficients and errors of a point."""
        return self._absolute.projection(point)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random poles, whose inputs fit the recording."""
        return self._all_completed(super().random(count, generator))

    def repair(self, points: Array) -> Array:
        """Move poles beyond the radius to it."""
        return np.array([self._absolute.moved(each, np.zeros_like(each)) for each in points])

    def values(self, points: Array) -> Array:
        """Objective of each row in percent, (M,)."""
        return np.array([self._absolute.value(point) for point in points])

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring with each section from one of two parents, and C, D and levels anew."""
        coordinates = parents[:, : self.errors.dimension]
        offspring, used = super().recombine(coordinates, count, generator)
        return self._all_completed(offspring), used + count

    def descents(self, points: Array, steps: int, tolerance: float) -> Descent:  # noqa: ARG002
        """Descents from each row, to the last digits where the tolerance asks for them."""
        return self._absolute.descents(points, SEARCH_WIDTH if tolerance >= TOLERANCE else None)

    def limited(self, errors: Array) -> Array:
        """Errors, (N, l), with those that stand out drawn in."""
        return limited(errors)

    def covariance(self, projection: Projection) -> ParameterCovariance | None:
        """Covariance of the entries; None where no density of the errors at zero is known.

        The sandwich of least absolute deviations (Bassett & Koenker 1978): signs over twice the
        density at zero take the place of the errors.
        """
        problem, samples = self.errors, self.errors.data.samples
        outputs = projection.errors.shape[1]
        estimated = problem.parameters + problem.order * problem.data.segments
        density = np.array(
            [density_at_zero(each, -(-estimated // outputs)) for each in projection.errors.T]
        )
        if not np.all(density > 0.0):
            return None
        scores = np.sign(projection.errors) / (2.0 * density)
        sizes = self._absolute.sizes
        weights = output_weights(projection.errors / sizes, self._absolute.weighing) / sizes
        own = replace(projection, errors=scores, covariance=scores.T @ scores / samples)
        return parameter_covariance(problem, own, np.diag(2.0 * density * weights))

    def _all_completed(self, coordinates: Array) -> Array:
        return np.array([self.completed(each) for each in coordinates])
