"""An objective as a function of coordinates of its points: those of constrained points, or the
reflection coefficients of sections."""

from typing import NamedTuple, Protocol

import numpy as np

from evopem.arrays import Array
from evopem.estimation.pem.k_step_errors import KStepErrors
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.pem.priors import Priors


class Mapped(NamedTuple):
    """Points of coordinates z, which move with *bounded* functions of each of these."""

    points: Array  # (M, n)
    derivatives: Array  # (M, n, k), by the bounded coordinates
    slopes: Array  # (M, k), of the bounded coordinates
    bends: Array  # (M, k), their second derivatives
    barriers: tuple[Array, Array, Array]  # with derivatives: (M,), (M, k), (M, k, k)


class Coordinates(Protocol):
    """How points follow from coordinates."""

    def mapped(self, z: Array) -> Mapped:
        """The points of rows of coordinates, (M, k)."""


class CoordinateErrors:
    """The objective of errors by coordinates, with ``prior_weight`` times the squared deviations
    from priors, in standard deviations."""

    def __init__(
        self,
        errors: PolynomialErrors | KStepErrors,
        coordinates: Coordinates,
        priors: Priors | None = None,
        prior_weight: float = 0.0,
    ) -> None:
        self.errors, self.coordinates, self.objective = errors, coordinates, errors.objective
        self.priors, self.prior_weight = priors, prior_weight

    def points(self, z: Array) -> Array:
        """Points of rows of coordinates, (M, n)."""
        return self.coordinates.mapped(z).points

    def values(self, z: Array) -> Array:
        """Objective of each row with its priors; inf where a barrier is crossed."""
        mapped = self._mapped(z)
        values = self.errors.values(mapped.points) + self._of_priors(mapped.points)[0]
        return np.where(np.isfinite(mapped.barriers[0]), values, np.inf)

    def values_and_gradients(
        self, z: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective of each row with barriers and priors, and its gradient."""
        mapped = self._mapped(z)
        barrier, by_bounded, _ = mapped.barriers
        values, slopes = self.errors.values_and_gradients(mapped.points, smoothing, barriers)
        prior, of_prior, _ = self._of_priors(mapped.points)
        inside = np.isfinite(values + barrier)
        weights = np.where(inside, barriers, 0.0)
        values = np.where(inside, values + prior + weights * np.where(inside, barrier, 0.0), np.inf)
        total = np.einsum("mn,mnk->mk", slopes + of_prior, mapped.derivatives)
        gradients = mapped.slopes * (total + weights[:, None] * by_bounded)
        return values, np.where(inside[:, None], gradients, 0.0)

    def curvatures(self, z: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton matrices, with the bend of bounded coordinates where it is positive."""
        mapped = self._mapped(z)
        matrices = self.errors.curvatures(mapped.points, smoothing, barriers)
        _, slopes = self.errors.values_and_gradients(mapped.points, smoothing, barriers)
        _, of_prior, of_priors = self._of_priors(mapped.points)
        moves = mapped.derivatives
        curved = np.swapaxes(moves, 1, 2) @ (matrices + of_priors) @ moves
        curved += barriers[:, None, None] * mapped.barriers[2]
        curved *= mapped.slopes[:, :, None] * mapped.slopes[:, None, :]
        # At an end of a bounded coordinate its slope vanishes, and this is the curvature.
        total = np.einsum("mn,mnk->mk", slopes + of_prior, moves)
        np.einsum("ijj->ij", curved)[:] += np.maximum(total * mapped.bends, 0.0)
        return np.asarray(curved)

    def _mapped(self, z: Array) -> Mapped:
        mapped = self.coordinates.mapped(z)
        # Errors of points beyond a barrier, which do not count, would overflow.
        mapped.points[~np.isfinite(mapped.barriers[0])] = 0.0
        return mapped

    def mean_absolute_residuals(self, values: Array) -> Array:
        """Size of the residuals that belong to values of the objective."""
        return self.errors.mean_absolute_residuals(values)

    def _of_priors(self, points: Array) -> tuple[Array, Array, Array]:
        """What the priors add to the objective, with derivatives by the points."""
        count, n = points.shape
        value, slope, bend = np.zeros(count), np.zeros((count, n)), np.zeros((count, n, n))
        if self.priors is not None and self.priors.terms:
            for row, point in enumerate(points):
                away, by_point = self.priors.deviations(point)
                value[row] = self.prior_weight * float(away @ away)
                slope[row] = 2.0 * self.prior_weight * (away @ by_point)
                bend[row] = 2.0 * self.prior_weight * (by_point.T @ by_point)
        return value, slope, bend
