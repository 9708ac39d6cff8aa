"""Descents in the sections' own coordinates, which move along the edge of the stability region:
where spare roots share a place on it, the region of coefficients has cusps.  Reflection
coefficients ``k = sin(phi)`` of sections make it a box, whose sides keep the modulus of a root."""

from dataclasses import replace

import numpy as np

from evopem.arrays import Array
from evopem.estimation.pem.batch_bfgs import Descent
from evopem.estimation.pem.coordinate_errors import CoordinateErrors, Mapped
from evopem.estimation.pem.kernels.polynomials import products_of_sections
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.root_sections import sections_of
from evopem.estimation.search.staged_descent import POLISH_STAGES, staged_descent

# How far inside the side of the box a descent begins: on it the slope is zero.
INSIDE = 1e-6
# By how much roots on the edge are drawn in, relative, until coefficients hold them within: a
# root of multiplicity m moves by the m-th root of the rounding.
DRAWN_IN = (1e-8, 1e-7, 1e-6, 1e-5)


class SectionCoordinates:
    """Reflection coefficients of the sections of A, C, D and F; other entries as in a point."""

    def __init__(self, errors: PolynomialErrors) -> None:
        self._polynomials = [(part, errors.radius_of(name)) for name, part in errors.polynomials()]

    def of_points(self, points: Array) -> Array:
        """Coordinates of feasible points, (M, n); roots on the edge go a little inside."""
        coordinates = points.copy()
        for part, radius in self._polynomials:
            for row in coordinates:
                sections = sections_of(row[part])
                second = np.clip(sections.quadratic[:, 1] / radius**2, INSIDE - 1.0, 1.0 - INSIDE)
                first = sections.quadratic[:, 0] / (radius * (1.0 + second))
                quadratic = np.column_stack([first, second]).ravel()
                reflections = np.concatenate([quadratic, -sections.single / radius])
                row[part] = np.arcsin(np.clip(reflections, INSIDE - 1.0, 1.0 - INSIDE))
        return coordinates

    def points(self, coordinates: Array, drawn_in: float = DRAWN_IN[0]) -> Array:
        """Points of coordinates, the largest radius less a part of it."""
        return self._derivatives(coordinates, drawn_in)[0]

    def mapped(self, z: Array) -> Mapped:
        """The points of rows of coordinates; there is no barrier to add."""
        points, of_polynomials = self._derivatives(z)
        derivatives = np.tile(np.eye(z.shape[1]), (len(z), 1, 1))
        slopes, bends = np.ones_like(z), np.zeros_like(z)
        for (part, _), of_polynomial in zip(self._polynomials, of_polynomials, strict=True):
            derivatives[:, part, part] = of_polynomial
            slopes[:, part], bends[:, part] = np.cos(z[:, part]), -np.sin(z[:, part])
        none = np.zeros(len(z)), np.zeros_like(z), np.zeros_like(derivatives)
        return Mapped(points, derivatives, slopes, bends, none)

    def _derivatives(
        self, coordinates: Array, drawn_in: float = DRAWN_IN[0]
    ) -> tuple[Array, list[Array]]:
        """Points, and the derivatives of each polynomial by its reflection coefficients."""
        points, derivatives = coordinates.copy(), []
        for part, radius in self._polynomials:
            reflections = np.ascontiguousarray(np.sin(coordinates[:, part]))
            points[:, part], of_part = products_of_sections(reflections, radius * (1.0 - drawn_in))
            derivatives.append(of_part)
        return points, derivatives


def in_sections(errors: PolynomialErrors) -> CoordinateErrors:
    """Prediction errors by these coordinates.  They alone hold the roots within the allowed radius,
    which coefficients with several roots on it would seem to leave by their rounding."""
    return CoordinateErrors(errors.within_radius(UNBOUNDED_RADIUS), SectionCoordinates(errors))


def descend_in_sections(errors: PolynomialErrors, points: Array, largest_value: float) -> Descent:
    """Descents to the last digits along the edge; never worse than where they began."""
    sections, asked = SectionCoordinates(errors), in_sections(errors)
    descents = staged_descent(
        asked, sections.of_points(points), POLISH_STAGES, largest_value, wait=None
    )
    ends, values = points.copy(), errors.values(points)
    evaluations = descents.evaluations + len(points)
    outside = np.arange(len(points))
    for drawn_in in DRAWN_IN:
        tried = sections.points(descents.points[outside], drawn_in)
        reached = errors.values(tried)
        evaluations += len(outside)
        lower = reached < values[outside]
        ends[outside[lower]], values[outside[lower]] = tried[lower], reached[lower]
        outside = outside[~np.isfinite(reached)]
    return replace(descents, points=ends, values=values, evaluations=evaluations)
