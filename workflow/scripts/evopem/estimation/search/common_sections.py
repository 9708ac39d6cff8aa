"""Sections that several polynomials of a model share: with one in A, B and C, in B and F, or in C
and D the residuals of orders two higher stay the same, and a descent from there can only gain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search.sections import each_without, random_sections, without_nearest_of
from evopem.models.structures import Orders

Array = NDArray[np.float64]

# Polynomials that may share a factor; the poles of the first are those of the section.
SHARING = ("fb", "abc", "dc")
# States, and the polynomial whose sections they share.
STATES_OF = {"plant": "f", "noise": "c"}
# Share of the places that have two real roots, and how far these lie from the unit circle at most
# and at least.
REAL_SHARE, FARTHEST_REAL, NEAREST_REAL = 0.2, 0.9, 0.003


def growth(orders: Orders) -> list[tuple[Orders, str]]:
    """Orders in steps of one common section up to some orders, with what shares the section.

    The first are the smallest, and share nothing; orders too small for smaller ones, and those of
    several inputs, are alone.

    Examples
    --------
    >>> from evopem.models.structures import armax_orders
    >>> [(str(each), shared) for each, shared in growth(armax_orders(4, 4, 4, 1))]
    [('ARMAX(2,2,2,1)', ''), ('ARMAX(4,4,4,1)', 'abc')]
    """
    steps: list[tuple[Orders, str]] = []
    while orders.inputs <= 1:
        before = len(steps)
        for shared in SHARING:
            smaller = with_fewer_sections(orders, shared)
            if smaller is not None:
                steps.append((orders, shared))
                orders = smaller
        if len(steps) == before:
            break
    return [(orders, ""), *reversed(steps)]


def with_fewer_sections(orders: Orders, shared: str) -> Orders | None:
    """Orders with a section less, or None where a polynomial would have no roots."""
    sharing = shared if orders.single.nb else shared.replace("b", "")
    lower = {f"n{name}": getattr(orders.single, f"n{name}") - 2 for name in sharing}
    if len(lower) < 2 or min(lower.values()) < 1:
        return None
    return replace(orders, **lower)


def places(count: int, generator: np.random.Generator) -> Array:
    """Monic sections, (count, 3), spread over all frequencies, damping, and real roots."""
    real = round(REAL_SHARE * count)
    distances = FARTHEST_REAL * (NEAREST_REAL / FARTHEST_REAL) ** generator.random((real, 2))
    roots = (1.0 - distances) * generator.choice([-1.0, 1.0], (real, 2))
    of_real = np.column_stack([np.ones(real), -roots.sum(axis=1), roots.prod(axis=1)])
    return np.concatenate([random_sections(count - real, generator), of_real])


def with_common_section(
    point: Array, smaller: PolynomialErrors, larger: PolynomialErrors, shared: str, sections: Array
) -> Array:
    """A point of smaller orders times each of some sections, (M, n).  The residuals are those of
    the point but for what the states do to the first of them."""
    own, parts, points = smaller.parts(), larger.parts(), []
    for section in sections:
        grown = np.zeros(larger.dimension)
        for name, part in own.items():
            coefficients = point[part]
            if name in "acdf" and name in shared:
                coefficients = np.convolve(np.append(1.0, coefficients), section)[1:]
            elif name == "b" and not len(coefficients):
                continue
            elif name == "b" and name in shared:
                coefficients = np.convolve(coefficients, section)
            elif STATES_OF.get(name, " ") in shared and len(coefficients):
                length = _states_of_stretch(name, larger.orders)
                of_stretches = coefficients.reshape(-1, _states_of_stretch(name, smaller.orders))
                times = [np.convolve(states, section)[:length] for states in of_stretches]
                coefficients = np.concatenate(times)
            grown[parts[name]] = coefficients
        points.append(grown)
    return np.array(points)


def without_common_section(
    point: Array, larger: PolynomialErrors, smaller: PolynomialErrors, shared: str
) -> Array:
    """A point without each section of the first of the polynomials that share, (M, n).  The others
    lose the section that lies nearest to it."""
    parts, kept, points = larger.parts(), smaller.parts(), []
    lead, *others = [name for name in shared if parts[name].stop > parts[name].start]
    for section, rest in each_without(point[parts[lead]]):
        shrunk = np.zeros(smaller.dimension)
        for name, part in kept.items():
            coefficients = point[parts[name]]
            if name in STATES_OF and len(coefficients):
                length = _states_of_stretch(name, smaller.orders)
                of_stretches = coefficients.reshape(-1, _states_of_stretch(name, larger.orders))
                coefficients = of_stretches[:, :length].ravel()
            if part.stop - part.start == len(coefficients):
                shrunk[part] = coefficients
        shrunk[kept[lead]] = rest[1:]
        left = {name: without_nearest_of(name, point[parts[name]], section) for name in others}
        for name, lower in left.items():
            if lower is not None:
                shrunk[kept[name]] = lower if name == "b" else lower[1:]
        if all(lower is not None for lower in left.values()):
            points.append(shrunk)
    return np.array(points).reshape(len(points), smaller.dimension)


def _states_of_stretch(name: str, orders: Orders) -> int:
    """How many states of the plant or of the noise a stretch has."""
    return orders.single.nf if name == "plant" else orders.noise_states
