"""Recombination of polynomials by their roots: second-order sections instead of coefficients.

Half of the coefficients of one polynomial and half of another make a third whose roots have nothing
to do with theirs.  Sections, each a conjugate pair or two real roots, keep their poles: a section
found by one model goes to another one as it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomials import roots

Array = NDArray[np.float64]


class Sections(NamedTuple):
    """Quadratic factors of a polynomial by the angle of their roots, (m // 2, 2), and a real root.

    The real root, (0,) or (1,), is left over where the degree is odd.
    """

    quadratic: Array
    single: Array


def sections_of(coefficients: Array) -> Sections:
    """Sections of ``1 + x_1 q^-1 + ... + x_m q^-m``; (m,) coefficients."""
    found = roots(coefficients)
    upper = found[found.imag > 0.0]
    real = np.sort(found[found.imag == 0.0].real)
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
    return Sections(factors[np.argsort(angles, kind="stable")], single)


def product_of(sections: Sections) -> Array:
    """Coefficients of the product of sections, without the leading 1."""
    product = np.ones(1)
    for factor in sections.quadratic:
        product = np.convolve(product, np.concatenate([[1.0], factor]))
    for root in sections.single:
        product = np.convolve(product, [1.0, -root])
    return product[1:]


def recombined_polynomials(
    polynomials: Array, pairs: NDArray[np.int64], generator: np.random.Generator
) -> Array:
    """Polynomials whose sections each come from one of two parents, in the order of frequency.

    ``polynomials`` (M, m): coefficients without the leading 1.  ``pairs`` (2, count): the parents
    of each.  Returns (count, m).
    """
    parents = [sections_of(coefficients) for coefficients in polynomials]
    count, order = pairs.shape[1], polynomials.shape[1]
    from_first = generator.random((count, order // 2 + order % 2)) < 0.5
    offspring = np.empty((count, order))
    if order == 0:
        return offspring
    for row, (one, other) in enumerate(pairs.T):
        first, second, chosen = parents[one], parents[other], from_first[row]
        quadratic = np.where(chosen[: order // 2, None], first.quadratic, second.quadratic)
        single = first.single if chosen[-1] else second.single
        offspring[row] = product_of(Sections(quadratic, single))
    return offspring
