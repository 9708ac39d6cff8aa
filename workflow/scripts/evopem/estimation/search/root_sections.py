"""Polynomials as products of second-order sections (pairs of roots), and descents in these."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from evopem.arrays import Array, Complex, Integers
from evopem.estimation.pem.derived_errors import CoordinateErrors, Mapped
from evopem.estimation.pem.kernels.bfgs import Descent
from evopem.estimation.pem.kernels.polynomials import products_of_sections
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.staged_descent import POLISH_STAGES, staged_descent
from evopem.models.polynomial_roots import roots

# Distances of random roots from the unit circle: as far as a pole that decays in a sample, and as
# near as one that rings for hundreds.
FARTHEST, NEAREST = 0.9, 0.003
# Places of a section that are tried at a step of basin hopping, half of them at the edge.
PLACES = 12
# Distances of a section's roots from the unit circle: as far as a pole that rings for two samples,
# and as near as one that rings for hundreds.
SECTION_FARTHEST, SECTION_NEAREST = 0.4, 0.003


class RootSections(NamedTuple):
    """Quadratic factors by the angle of their roots, (m // 2, 2), and the real root left over."""

    quadratic: Array
    single: Array


def sections_of(coefficients: Array) -> RootSections:
    """Sections of ``1 + x_1 q^-1 + ... + x_m q^-m``; (m,) coefficients."""
    all_roots = roots(coefficients)
    upper = all_roots[all_roots.imag > 0.0]
    real = np.sort(all_roots[all_roots.imag == 0.0].real)
    odd = len(coefficients) % 2
    single, paired = real[len(real) - odd :], real[: len(real) - odd].reshape(-1, 2)
    factors = np.concatenate(
        [
            np.column_stack([-2.0 * upper.real, np.abs(upper) ** 2]),
            np.column_stack([-paired.sum(axis=1), paired.prod(axis=1)]),
        ]
    )
    # Two real roots stand at the frequency zero, or at half the sampling rate.
    angles = np.concatenate([np.angle(upper), np.where(paired[:, 1] > 0.0, 0.0, np.pi)])
    return RootSections(factors[np.argsort(angles, kind="stable")], single)


def product_of(sections: RootSections) -> Array:
    """Coefficients of the product of sections, without the leading 1."""
    product = np.ones(1)
    for factor in sections.quadratic:
        product = np.convolve(product, np.concatenate([[1.0], factor]))
    for root in sections.single:
        product = np.convolve(product, [1.0, -root])
    return product[1:]


def recombined_polynomials(
    polynomials: Array, pairs: Integers, generator: np.random.Generator
) -> Array:
    """Polynomials, (count, m), whose sections each come from one of two parents, by frequency.
    ``polynomials`` (M, m): without the leading 1.  ``pairs`` (2, count): the parents of each."""
    parents = [sections_of(coefficients) for coefficients in polynomials]
    count, order = pairs.shape[1], polynomials.shape[1]
    from_first = generator.random((count, order // 2 + order % 2)) < 0.5
    offspring = np.empty((count, order))
    if order == 0:
        return offspring
    for row, (mother, father) in enumerate(pairs.T):
        first, second, chosen = parents[mother], parents[father], from_first[row]
        quadratic = np.where(chosen[: order // 2, None], first.quadratic, second.quadratic)
        single = first.single if chosen[-1] else second.single
        offspring[row] = product_of(RootSections(quadratic, single))
    return offspring


def random_sections(count: int, generator: np.random.Generator) -> Array:
    """Monic quadratic polynomials, (count, 3), spread over all frequencies and over the damping."""
    angles = np.pi * (np.arange(count) + generator.random(count)) / count
    radii = 1.0 - SECTION_FARTHEST * (SECTION_NEAREST / SECTION_FARTHEST) ** generator.random(count)
    return np.column_stack([np.ones(count), -2.0 * radii * np.cos(angles), radii**2])


def each_without(coefficients: Array) -> Iterator[tuple[Array, Array]]:
    """Each section of a polynomial, (2,), and the polynomial without it, with the leading 1."""
    sections = sections_of(coefficients)
    for row, section in enumerate(sections.quadratic):
        rest = RootSections(np.delete(sections.quadratic, row, axis=0), sections.single)
        yield section, np.append(1.0, product_of(rest))


def with_exchanged_sections(point: Array, parts: Sequence[slice]) -> Iterator[Array]:
    """Points, (n,), with a section of one polynomial and one of another exchanged."""
    for first, second in combinations(parts, 2):
        pairs = product(each_without(point[first]), each_without(point[second]))
        for (section, kept), (replaced, remaining) in pairs:
            exchanged = point.copy()
            exchanged[first] = np.convolve(kept, np.append(1.0, replaced))[1:]
            exchanged[second] = np.convolve(remaining, np.append(1.0, section))[1:]
            yield exchanged


def at_radius(radius: float, c: Array, generator: np.random.Generator) -> Iterator[Array]:
    """Polynomials (m,) with one section at a radius, by its own angle, by random ones or with real
    roots, or with the real root left over there."""
    sections = sections_of(c)
    for (first, second), rest in each_without(c):
        angle = np.angle(-first + 1j * np.sqrt(max(4.0 * second - first**2, 0.0)))
        drawn = np.pi * (np.arange(PLACES // 2) + generator.random(PLACES // 2)) / (PLACES // 2)
        at_angles = [[-2.0 * radius * np.cos(turn), radius**2] for turn in (angle, *drawn)]
        for factor in (*at_angles, [-radius, 0.0], [radius, 0.0], [0.0, -(radius**2)]):
            yield np.convolve(rest, [1.0, *factor])[1:]
    for end in (-radius, radius) if len(sections.single) else ():
        yield product_of(sections._replace(single=np.array([end])))


def without_nearest_of(name: str, coefficients: Array, section: Array) -> Array | None:
    """Coefficients of a polynomial as a point holds them, with the leading one, of B any number,
    without the section nearest to another one; None where it has no section."""
    gain = coefficients[0] if name == "b" and len(coefficients) else 1.0
    if gain == 0.0:
        return None
    sections = each_without(coefficients[1:] / gain if name == "b" else coefficients)
    near = _section_roots(section)
    rests = [
        (np.min(np.abs(_section_roots(apart)[:, None] - near)), rest) for apart, rest in sections
    ]
    return gain * min(rests, key=lambda pair: pair[0])[1] if rests else None


def with_moved_section(
    point: Array, lead: slice, others: Sequence[tuple[str, slice]], generator: np.random.Generator
) -> list[Array]:
    """Points with each section of a polynomial, and the nearest of others, at random places."""
    moved = []
    for section, rest in each_without(point[lead]):
        left = [(part, without_nearest_of(name, point[part], section)) for name, part in others]
        for factor in random_sections(PLACES, generator):
            neighbour = point.copy()
            neighbour[lead] = np.convolve(rest, factor)[1:]
            for part, near in left:
                if near is not None:
                    whole = np.convolve(near, factor)
                    neighbour[part] = whole[len(whole) - part.stop + part.start :]
            moved.append(neighbour)
    return moved


def _section_roots(section: Array) -> Complex:
    half = -0.5 * section[0]
    spread = np.sqrt(complex(half * half - section[1]))
    return np.array([half + spread, half - spread])


def random_denominators(count: int, order: int, generator: np.random.Generator) -> Array:
    """Polynomials with roots spread over all frequencies and over the damping, (count, order)."""
    pairs, single = order // 2, order % 2
    drawn, signs = np.empty((count, order)), np.empty((count, single))
    for uniform, sign in zip(drawn, signs, strict=True):
        uniform[:] = generator.random(order)
        sign[:] = 2.0 * generator.integers(2, size=single) - 1.0
    radii = 1.0 - FARTHEST * (NEAREST / FARTHEST) ** drawn[:, pairs:]
    upper = radii[:, :pairs] * np.exp(1j * np.pi * drawn[:, :pairs])
    monic = np.eye(1, order + 1, dtype=complex).repeat(count, axis=0)
    roots = np.concatenate([upper, upper.conj(), signs * radii[:, pairs:]], axis=1)
    for degree, root in enumerate(roots.T, start=1):
        monic[:, 1 : degree + 1] -= root[:, None] * monic[:, :degree]
    return np.ascontiguousarray(monic[:, 1:].real)


INSIDE = 1e-6  # how far inside the side of the box a descent begins: on it the slope is zero
# By how much roots on the edge are drawn in, relative, until coefficients hold them within: a
# root of multiplicity m moves by the m-th root of the rounding.
DRAWN_IN = (1e-8, 1e-7, 1e-6, 1e-5)


class SectionCoordinates:
    """Reflection coefficients of the sections of A, C, D and F; other entries as in a point."""

    def __init__(self, errors: PolynomialErrors) -> None:
        self._polynomials = [(part, errors.radius_of(name)) for name, part in errors.polynomials]

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
