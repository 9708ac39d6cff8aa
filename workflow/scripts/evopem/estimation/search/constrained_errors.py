"""Prediction errors of models that meet constraints, with priors, in free coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.constrained_parameters import ConstrainedParameters
from evopem.estimation.pem.k_step_errors import KStepErrors, SimulationErrors
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.pem.priors import Priors

Array = NDArray[np.float64]


class ConstrainedErrors:
    """An objective as a function of the coordinates of :class:`ConstrainedParameters`, with
    ``prior_weight`` times the squared deviations from priors, in standard deviations."""

    def __init__(
        self,
        errors: PolynomialErrors | KStepErrors | SimulationErrors,
        parameters: ConstrainedParameters,
        priors: Priors,
        prior_weight: float,
    ) -> None:
        self.errors, self.parameters = errors, parameters
        self.priors, self.prior_weight = priors, prior_weight
        self.objective = errors.objective

    def points(self, coordinates: Array) -> Array:
        """Points of rows of coordinates, (M, n)."""
        return np.array(
            [self.parameters.point(self.parameters.bounded(z)[0])[0] for z in coordinates]
        )

    def values(self, coordinates: Array) -> Array:
        """Objective of each row with its priors; inf where a barrier is crossed."""
        points = self.points(coordinates)
        values = self.errors.values(points)
        for row, z in enumerate(coordinates):
            barrier, _, _ = self.parameters.barriers(self.parameters.bounded(z)[0])
            values[row] += self._prior(points[row])[0] if np.isfinite(barrier) else np.inf
        return values

    def values_and_gradients(
        self, coordinates: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row with barriers and priors, and its gradient."""
        maps = [self._map(z) for z in coordinates]
        points = np.array([point for point, _, _, _, _ in maps])
        values, slopes = self.errors.values_and_gradients(points, smoothing, barriers)
        gradients = np.zeros(coordinates.shape)
        for row, (point, derivatives, bounded, slope, _) in enumerate(maps):
            barrier, of_barrier, _ = self.parameters.barriers(bounded)
            if not np.isfinite(values[row] + barrier):
                values[row] = np.inf
                continue
            prior, of_prior, _ = self._prior(point)
            values[row] += prior + barriers[row] * barrier
            total = (slopes[row] + of_prior) @ derivatives
            gradients[row] = slope * (total + barriers[row] * of_barrier)
        return values, gradients

    def curvatures(self, coordinates: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton matrices, with the bend of bounded coordinates where it is positive."""
        maps = [self._map(z) for z in coordinates]
        points = np.array([point for point, _, _, _, _ in maps])
        matrices = self.errors.curvatures(points, smoothing, barriers)
        _, slopes = self.errors.values_and_gradients(points, smoothing, barriers)
        found = np.zeros((len(coordinates), coordinates.shape[1], coordinates.shape[1]))
        for row, (point, derivatives, bounded, slope, bend) in enumerate(maps):
            _, of_prior, of_priors = self._prior(point)
            _, _, of_barrier = self.parameters.barriers(bounded)
            matrix = derivatives.T @ (matrices[row] + of_priors) @ derivatives
            found[row] = slope[:, None] * (matrix + barriers[row] * of_barrier) * slope
            # At an end of a share the slope vanishes, and this is the curvature.
            total = (slopes[row] + of_prior) @ derivatives
            found[row] += np.diag(np.maximum(total * bend, 0.0))
        return found

    def mean_absolute_residuals(self, values: Array) -> Array:
        """Size of the residuals that belong to values of the objective."""
        return self.errors.mean_absolute_residuals(values)

    def _prior(self, point: Array) -> tuple[float, Array | float, Array | float]:
        """What the priors add to the objective, and its derivatives by the point."""
        if not self.priors.terms:
            return 0.0, 0.0, 0.0
        away, by_point = self.priors.deviations(point)
        weight = self.prior_weight
        return (
            weight * float(away @ away),
            2.0 * weight * (away @ by_point),
            2.0 * weight * (by_point.T @ by_point),
        )

    def _map(self, z: Array) -> tuple[Array, Array, Array, Array, Array]:
        bounded, slope, bend = self.parameters.bounded(z)
        return *self.parameters.point(bounded), bounded, slope, bend
