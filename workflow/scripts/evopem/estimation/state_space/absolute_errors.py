"""The sum of absolute errors of state-space models: C, D and levels are part of a point.

Absolute errors of several outputs have no common least-squares solution, so that nothing is
eliminated.  A point is that of :mod:`.errors`, followed by C, D and the constants of each output.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.absolute_descent import (
    ROUNDING,
    Places,
    Weighing,
    criterion,
    descend,
    linear_coefficients,
    polish,
)
from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.state_space.errors import Projection, StateSpaceErrors
from evopem.estimation.state_space.levenberg_marquardt import EDGE
from evopem.estimation.state_space.sections import inside, largest_radius, moved, scale_of

Array = NDArray[np.float64]


class AbsoluteStateSpaceErrors:
    """Errors, Jacobians and feasibility of models whose C, D and levels are part of a point.

    Parameters
    ----------
    quadratic : StateSpaceErrors
        Record, order, form and radius; of its weightings ``power`` weighs the outputs by their
        power, and all others by their noise.

    Attributes
    ----------
    sizes : (ny,) array
        Mean absolute values of the outputs, in the units of the record.
    """

    def __init__(self, quadratic: StateSpaceErrors) -> None:
        self.quadratic = quadratic
        self.weighing: Weighing = "power" if quadratic.weighting == "power" else "noise"
        outputs = quadratic.record.outputs
        self.sizes = np.mean(np.abs(outputs), axis=0)
        self.sizes[self.sizes == 0.0] = 1.0
        self._regressors = quadratic.order + sum(each.shape[1] for each in quadratic.direct)
        self._latest: tuple[Array, Projection] | None = None

    @property
    def dimension(self) -> int:
        """Length of a point."""
        return self.quadratic.dimension + self._regressors * len(self.sizes)

    def projection(self, point: Array) -> Projection:
        """States and errors of a point; the errors in the units of the record."""
        if self._latest is None or not np.array_equal(self._latest[0], point):
            count = self.quadratic.dimension
            linear = point[count:].reshape(len(self.sizes), self._regressors).T
            found = self.quadratic.with_linear(point[:count], linear)
            self._latest = (point.copy(), found)
        return self._latest[1]

    def errors(self, point: Array) -> Array:
        """Errors over the mean absolute values of their outputs, (N, ny)."""
        if not np.isfinite(point).all():
            return np.full(self.quadratic.record.outputs.shape, np.nan)
        return np.asarray(self.projection(point).errors / self.sizes)

    def jacobians(self, point: Array) -> Iterator[tuple[Array, Places]]:
        """Derivatives of the errors of each output by its part of a point."""
        problem, found = self.quadratic, self.projection(point)
        signals = problem.signals.derivatives(found.sections, found.states)
        own = np.arange(self._regressors)
        shared = np.arange(problem.dimension)
        for k, size in enumerate(self.sizes):
            by_coordinates = problem.derivatives.of_output(
                found.sections, signals, found.linear[: problem.order, k]
            )
            columns = np.column_stack([by_coordinates, found.regressors]) / -size
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
        found = self.quadratic.projection(coordinates)
        along = linear_coefficients(found.basis, self.quadratic.record.outputs)
        triangle = found.basis.T @ found.regressors
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
        return Descent(
            points=np.array([optimum.point for optimum in optima]).reshape(points.shape),
            values=np.array([self.percent(optimum.value) for optimum in optima]),
            converged=np.array([optimum.converged for optimum in optima], dtype=bool),
            evaluations=sum(optimum.evaluations for optimum in optima),
        )
