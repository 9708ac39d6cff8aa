"""The sum of absolute errors of state-space models as the memetic search sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.absolute_descent import (
    SEARCH_WIDTH,
    SWEEP_WIDTH,
    output_weights,
)
from evopem.estimation.damped_descent import Optimum
from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.covariance import density_at_zero
from evopem.estimation.state_space.absolute_errors import AbsoluteStateSpaceErrors
from evopem.estimation.state_space.covariance import parameter_covariance
from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.noise_colour import limited
from evopem.estimation.state_space.problem import TOLERANCE, StateSpaceProblem
from evopem.estimation.state_space.settings import Objective
from evopem.models.parameter_covariance import ParameterCovariance

Array = NDArray[np.float64]

# Quadratic optima of an order that are descended from in the search over orders.
DESCENDED = 3


class AbsoluteStateSpaceProblem(StateSpaceProblem):
    """As :class:`.StateSpaceProblem`; C, D and levels are part of a point."""

    objective: Objective = "absolute"

    def __init__(self, errors: StateSpaceErrors) -> None:
        super().__init__(errors)
        self.grams = errors.record.outputs.shape[1]
        self._absolute = AbsoluteStateSpaceErrors(errors)

    def nearest(self, coordinates: list[Array]) -> tuple[Array, int]:
        """Optima next to those of the quadratic objective, (m, n), and the evaluations."""
        points = [self.completed(each) for each in coordinates]
        found = self._absolute.descents(
            np.array(points).reshape(-1, self._absolute.dimension), SEARCH_WIDTH
        )
        return found.points, found.evaluations + len(points)

    def lowest_of(self, optima: list[Optimum]) -> tuple[Array, float, int]:
        """The lowest optimum next to those of the quadratic objective, its value, evaluations."""
        points = np.array([self.completed(each.point) for each in optima[:DESCENDED]])
        found = self._absolute.descents(points, SWEEP_WIDTH)
        lowest = int(np.argmin(found.values))
        return found.points[lowest], float(found.values[lowest]), found.evaluations

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
        """Independent points with random poles, whose inputs fit the record."""
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
        """Errors, (N, ny), with those that stand out drawn in."""
        return limited(errors)

    def covariance(self, found: Projection) -> ParameterCovariance | None:
        """Covariance of the entries; None where no density of the errors at zero is known.

        The sandwich of least absolute deviations (Bassett & Koenker 1978): signs over twice the
        density at zero take the place of the errors.
        """
        problem, samples = self.errors, self.errors.record.samples
        outputs = found.errors.shape[1]
        estimated = problem.parameters + problem.order * problem.record.records
        density = np.array(
            [density_at_zero(each, -(-estimated // outputs)) for each in found.errors.T]
        )
        if not np.all(density > 0.0):
            return None
        scores = np.sign(found.errors) / (2.0 * density)
        sizes = self._absolute.sizes
        weights = output_weights(found.errors / sizes, self._absolute.weighing) / sizes
        own = replace(found, errors=scores, covariance=scores.T @ scores / samples)
        return parameter_covariance(problem, own, np.diag(2.0 * density * weights))

    def _all_completed(self, coordinates: Array) -> Array:
        return np.array([self.completed(each) for each in coordinates])
