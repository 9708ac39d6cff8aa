"""Individuals grown from smaller orders: a start of the search for over-parameterised models.

A model of orders (na, nb, nc) times a quadratic factor in A, B and C alike is a model of orders two
higher with the very same residuals.  A descent from there can only gain, and where the factor's
roots lie decides how much: the Gauss-Newton decrease tells before the descent.  Growing pair by
pair from the smallest order so finds good places for the roots that a random draw misses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.models.structures import Orders, armax_orders

Array = NDArray[np.float64]

# Distances of a factor's roots from the unit circle: as far as a pole that rings for two samples,
# and as near as one that rings for hundreds.
FARTHEST, NEAREST = 0.4, 0.003


def smaller_orders(orders: Orders) -> list[Orders]:
    """The orders that lead to ``orders`` in steps of a pair of roots, smallest first."""
    pairs = (min(orders.na, orders.single.nb, orders.nc) - 1) // 2
    return [
        armax_orders(
            orders.na - 2 * k, orders.single.nb - 2 * k, orders.nc - 2 * k, orders.single.nk
        )
        for k in range(pairs, 0, -1)
    ]


def random_pairs(count: int, generator: np.random.Generator) -> NDArray[np.complex128]:
    """Upper roots of quadratic factors, spread over all frequencies and over the damping."""
    angles = np.pi * (np.arange(count) + generator.random(count)) / count
    distances = FARTHEST * (NEAREST / FARTHEST) ** generator.random(count)
    pairs: NDArray[np.complex128] = (1.0 - distances) * np.exp(1j * angles)
    return pairs


def with_factor(errors: PolynomialErrors, point: Array, roots: NDArray[np.complex128]) -> Array:
    """A point times quadratic factors in A, B, C and the noise state: equal residuals.

    ``point`` (n,), ``roots`` (M,): the upper root of each factor.  Returns (M, n + 8): points of
    the orders two higher in na, nb and nc.
    """
    o, start = errors.orders, errors.residual_start
    a = np.concatenate([[1.0], point[: o.na]])
    b = point[o.na : o.na + o.single.nb]
    c = np.concatenate([[1.0], point[o.na + o.single.nb : o.parameters]])
    state = point[o.parameters :]
    # The larger model's equation error reaches back to where the smaller one's did not count.
    before = [
        a @ errors.output[t - o.na : t + 1][::-1]
        - b @ errors.input[t - o.single.nk - o.single.nb + 1 : t - o.single.nk + 1][::-1]
        for t in (start - 1, start - 2)
    ]
    points = np.empty((len(roots), len(point) + 8))
    for row, root in enumerate(roots):
        factor = np.array([1.0, -2.0 * root.real, abs(root) ** 2])
        larger_state = np.convolve(state, factor)
        larger_state[0] -= factor[1] * before[0] + factor[2] * before[1]
        larger_state[1] -= factor[2] * before[0]
        points[row] = np.concatenate(
            [
                np.convolve(a, factor)[1:],
                np.convolve(b, factor),
                np.convolve(c, factor)[1:],
                larger_state,
            ]
        )
    return points


def padded(point: Array, smaller: Orders, larger: Orders, level: bool = False) -> Array:
    """A point as one of larger orders that contain its own: zeros added, equal residuals.

    ``point`` (n,): coefficients of A, B, C, D and F, the level where there is one, plant and noise
    state.  ``smaller``, ``larger``: ``larger.contains(smaller)``, with recursions that start at the
    same sample.  ``level``: whether the points have a level.
    """

    def lengths(o: Orders) -> list[int]:
        return [o.na, o.single.nb, o.nc, o.nd, o.single.nf, int(level), o.single.nf, o.noise_states]

    parts = np.split(point, np.cumsum(lengths(smaller))[:-1])
    earlier = smaller.single.nk - larger.single.nk if smaller.single.nb else 0
    before = [0, earlier, 0, 0, 0, 0, 0, 0]
    return np.concatenate(
        [
            np.pad(part, (first, length - first - len(part)))
            for part, first, length in zip(parts, before, lengths(larger), strict=True)
        ]
    )
