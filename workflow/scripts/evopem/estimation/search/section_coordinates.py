"""Descents in the sections' own coordinates, which move along the edge of the stability region:
where spare roots share a place on it, the region of coefficients has cusps.  Reflection
coefficients ``k = sin(phi)`` of sections make it a box, on whose sides a root moves by its angle
alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.kernels.polynomials import products_of_sections
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.root_sections import sections_of
from evopem.estimation.search.staged_descent import POLISH_STAGES, staged_descent

Array = NDArray[np.float64]

# Radius within which the errors are asked for: the coordinates hold the roots within the allowed
# one, which coefficients with several roots on it would seem to leave by their rounding.
ASKED_WITHIN = 1.05
# How far inside the side of the box a descent begins: on it the slope is zero.
INSIDE = 1e-6
# By how much roots on the edge are drawn in, relative, until coefficients hold them within: a
# root of multiplicity m moves by the m-th root of the rounding.
DRAWN_IN = (1e-8, 1e-7, 1e-6, 1e-5)


class SectionCoordinates:
    """Prediction errors as functions of the sections of A, C, D and F."""

    def __init__(self, errors: PolynomialErrors) -> None:
        self._errors = errors.within_radius(ASKED_WITHIN)
        self._polynomials = [(part, errors.radius_of(name)) for name, part in errors.polynomials()]

    def of_points(self, points: Array) -> Array:
        """Coordinates of feasible points, (M, n); roots on the edge go a little inside."""
        coordinates = points.copy()
        for part, radius in self._polynomials:
            for row in coordinates:
                found = sections_of(row[part])
                second = np.clip(found.quadratic[:, 1] / radius**2, INSIDE - 1.0, 1.0 - INSIDE)
                first = found.quadratic[:, 0] / (radius * (1.0 + second))
                quadratic = np.column_stack([first, second]).ravel()
                reflections = np.concatenate([quadratic, -found.single / radius])
                row[part] = np.arcsin(np.clip(reflections, INSIDE - 1.0, 1.0 - INSIDE))
        return coordinates

    def points(self, coordinates: Array, drawn_in: float = DRAWN_IN[0]) -> Array:
        """Points of coordinates, the largest radius less a part of it."""
        return self._derivatives(coordinates, drawn_in)[0]

    def values(self, coordinates: Array) -> Array:
        """Objective of each row, (M,)."""
        return self._errors.values(self.points(coordinates))

    def values_and_gradients(
        self, coordinates: Array, smoothing: Array, barriers: Array
    ) -> tuple[Array, Array]:
        """Smoothed objective and its gradient; there is no barrier to add."""
        points, derivatives = self._derivatives(coordinates)
        values, gradients = self._errors.values_and_gradients(points, smoothing, 0.0 * barriers)
        return values, self._by_reflections(derivatives, gradients) * self._slopes(coordinates)

    def curvatures(self, coordinates: Array, smoothing: Array, barriers: Array) -> Array:
        """Gauss-Newton matrices, (M, n, n), with what the sides of the box add to them."""
        points, derivatives = self._derivatives(coordinates)
        none = 0.0 * barriers
        matrices = self._errors.curvatures(points, smoothing, none)
        for once in (matrices, np.swapaxes(matrices, 1, 2)):
            for (part, _), derivative in zip(self._polynomials, derivatives, strict=True):
                once[:, :, part] = once[:, :, part] @ derivative
        slopes = self._slopes(coordinates)
        matrices *= slopes[:, :, None] * slopes[:, None, :]
        _, gradients = self._errors.values_and_gradients(points, smoothing, none)
        bent = -np.sin(coordinates) * self._by_reflections(derivatives, gradients)
        for part, _ in self._polynomials:
            np.einsum("ijj->ij", matrices)[:, part] += np.maximum(bent[:, part], 0.0)
        return matrices

    def mean_absolute_residuals(self, values: Array) -> Array:
        """Size of the residuals that belong to values of the objective."""
        return self._errors.mean_absolute_residuals(values)

    def _derivatives(
        self, coordinates: Array, drawn_in: float = DRAWN_IN[0]
    ) -> tuple[Array, list[Array]]:
        """Points, and the derivatives of each polynomial by its reflection coefficients."""
        points, derivatives = coordinates.copy(), []
        for part, radius in self._polynomials:
            reflections = np.ascontiguousarray(np.sin(coordinates[:, part]))
            points[:, part], each = products_of_sections(reflections, radius * (1.0 - drawn_in))
            derivatives.append(each)
        return points, derivatives

    def _by_reflections(self, derivatives: list[Array], gradients: Array) -> Array:
        """Gradients by the reflection coefficients and by the entries that are none."""
        changed = gradients.copy()
        for (part, _), derivative in zip(self._polynomials, derivatives, strict=True):
            changed[:, part] = np.einsum("rij,ri->rj", derivative, gradients[:, part])
        return changed

    def _slopes(self, coordinates: Array) -> Array:
        """Derivatives of the reflection coefficients by the coordinates, 1 elsewhere."""
        slopes = np.ones_like(coordinates)
        for part, _ in self._polynomials:
            slopes[:, part] = np.cos(coordinates[:, part])
        return slopes


def descend_in_sections(errors: PolynomialErrors, points: Array, largest_value: float) -> Descent:
    """Descents to the last digits along the edge; never worse than where they began."""
    sections = SectionCoordinates(errors)
    found = staged_descent(
        sections, sections.of_points(points), POLISH_STAGES, largest_value, wait=None
    )
    ends, values = points.copy(), errors.values(points)
    evaluations = found.evaluations + len(points)
    outside = np.arange(len(points))
    for drawn_in in DRAWN_IN:
        tried = sections.points(found.points[outside], drawn_in)
        reached = errors.values(tried)
        evaluations += len(outside)
        lower = reached < values[outside]
        ends[outside[lower]], values[outside[lower]] = tried[lower], reached[lower]
        outside = outside[~np.isfinite(reached)]
    return replace(found, points=ends, values=values, evaluations=evaluations)
