"""The state-space problem as the memetic search sees it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.damped_descent import Optimum
from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.state_space.covariance import parameter_covariance
from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.levenberg_marquardt import descend
from evopem.estimation.state_space.sections import inside, normalised
from evopem.estimation.state_space.settings import Objective
from evopem.estimation.state_space.starting_points import from_poles, random_poles
from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]

# Steps and tolerance of a descent of the search, and of the last one.
STEPS, TOLERANCE = 100, 1e-7
POLISH_STEPS, POLISH_TOLERANCE = 1000, 1e-11
# Random points of the first batch of a multistart check suffice.
MIN_MULTISTART = 1


class StateSpaceProblem:
    """Search problem of one record, order and form; see :class:`evopem...search.problem.Problem`.

    Parameters
    ----------
    errors : StateSpaceErrors
    """

    objective: Objective = "quadratic"
    grams = 1
    """Gram matrices of one set of normal equations."""

    def __init__(self, errors: StateSpaceErrors) -> None:
        self.errors = errors
        self._starts: Array | None = None

    def start_from(self, coordinates: list[Array]) -> int:
        """Let the first population hold these points; returns the evaluations it took."""
        self._starts, used = self.nearest(coordinates)
        return used

    def nearest(self, coordinates: list[Array]) -> tuple[Array, int]:
        """Points next to optima of the quadratic objective, (m, n), and the evaluations."""
        return np.array(coordinates).reshape(-1, self.errors.dimension), 0

    def lowest_of(self, optima: list[Optimum]) -> tuple[Array, float, int]:
        """The lowest optimum next to those of the quadratic objective, its value, evaluations."""
        return optima[0].point, self.errors.percent(optima[0].value), 0

    def completed(self, coordinates: Array) -> Array:
        """The point of some coordinates."""
        return coordinates

    def coordinates(self, point: Array) -> Array:
        """The coordinates of a point."""
        return point

    def projection(self, point: Array) -> Projection:
        """States, linear coefficients and errors of a point."""
        return self.errors.projection(point)

    def limited(self, errors: Array) -> Array:
        """Errors, (N, ny), as their autoregression is fitted to them."""
        return errors

    def covariance(self, found: Projection) -> ParameterCovariance | None:
        """Covariance of the entries of the model."""
        return parameter_covariance(self.errors, found, self.errors.weights(found.covariance))

    @property
    def min_multistart(self) -> int:
        """Random points that a multistart check takes at least."""
        return MIN_MULTISTART

    def draw(self, count: int, generator: np.random.Generator) -> tuple[Array, int]:
        """A population, and the evaluations that it took; the first one holds the estimates."""
        if self._starts is None:
            return self.random(count, generator), count
        points = np.vstack([self._starts, self.random(max(count // 3, 1), generator)])
        if len(points) < count:
            points = np.vstack([points, self.random(count - len(points), generator)])
        self._starts = None
        values = self.values(points)
        best = np.argsort(values, kind="stable")[:count]
        return points[best], 2 * len(points)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Independent points with random poles, whose inputs fit the record."""
        order = self.errors.order
        return np.array(
            [from_poles(self.errors, random_poles(order, generator)) for _ in range(count)]
        )

    def repair(self, points: Array) -> Array:
        """Move poles beyond the radius to it."""
        limit = self.errors.radius * (1.0 - 1e-6)
        return np.array([inside(self.errors.layout, point, limit) for point in points])

    def values(self, points: Array) -> Array:
        """Criterion of each row in percent, (M,)."""
        return np.array([self.errors.percent(self.errors.value(point)) for point in points])

    def descend(self, points: Array) -> Descent:
        """Levenberg-Marquardt from each row."""
        return self.descents(points, STEPS, TOLERANCE)

    def polish(self, points: Array) -> Descent:
        """Levenberg-Marquardt from each row to the last digits."""
        return self.descents(points, POLISH_STEPS, POLISH_TOLERANCE)

    def recombine(
        self, parents: Array, count: int, generator: np.random.Generator
    ) -> tuple[Array, int]:
        """Offspring with each section, poles and inputs, from one of two parents; no evaluations.

        Sections are ordered by the angle of their poles: those of one place are much alike.
        """
        layout = self.errors.layout
        pairs = generator.integers(len(parents), size=(2, count))
        from_first = generator.random((count, layout.sections)) < 0.5
        offspring = parents[pairs[1]].copy()
        for child, first, chosen in zip(offspring, parents[pairs[0]], from_first, strict=True):
            rows, other = layout.pair_rows(child), layout.pair_rows(first)
            taken = chosen[: layout.pairs]
            rows[taken] = other[taken]
            if layout.single and chosen[-1]:
                layout.single_row(child)[:] = layout.single_row(first)
        return np.array([normalised(layout, child) for child in offspring]), 0

    def descents(self, points: Array, steps: int, tolerance: float) -> Descent:
        """Descents of at most some steps from each row."""
        optima = [descend(self.errors, point, steps, tolerance) for point in points]
        return Descent(
            points=np.array([optimum.point for optimum in optima]).reshape(points.shape),
            values=np.array([self.errors.percent(optimum.value) for optimum in optima]),
            converged=np.array([optimum.converged for optimum in optima], dtype=bool),
            evaluations=sum(optimum.evaluations for optimum in optima),
        )
