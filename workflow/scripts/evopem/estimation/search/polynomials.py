"""Polynomials that descents start from, by linear algebra on one record of inputs u (N, m), and
polynomials as products of second-order sections, each a conjugate pair or two real roots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.polynomials import filter_rows
from evopem.models.polynomials import reflect_into_disc, roots

Array = NDArray[np.float64]

# Distances of random roots from the unit circle: as far as a pole that decays in a sample, and as
# near as one that rings for hundreds.
FARTHEST, NEAREST = 0.9, 0.003
STEIGLITZ_MCBRIDE_STEPS = 20
# Rows of block Hankel matrices, in orders of the model, and the most of them.
HANKEL_ROWS, MOST_HANKEL_ROWS = 3, 40


def arx_denominator(u: Array, y: Array, order: int, nb: Sequence[int], nk: Sequence[int]) -> Array:
    """A of the ARX model of least squares, (order,)."""
    return _arx(u, y, order, nb, nk)[:order]


def steiglitz_mcbride(
    u: Array, y: Array, order: int, nb: Sequence[int], nk: Sequence[int], radius: float
) -> Iterator[Array]:
    """Denominators of the iteration by Steiglitz & McBride (1965), one a step, (order,) each.  ARX
    models of inputs and output, all filtered through the denominator before."""
    denominator = np.zeros(order)
    for _ in range(STEIGLITZ_MCBRIDE_STEPS):
        filtered = np.stack([*u.T, y])
        filter_rows(filtered, np.append(1.0, denominator), np.zeros((len(filtered), order)))
        found = _arx(filtered[:-1].T, filtered[-1], order, nb, nk)[:order]
        if not np.isfinite(found).all():
            return
        denominator = reflect_into_disc(found[None, :], radius)[0]
        yield denominator


def long_arx_responses(u: Array, y: Array, order: int, nk: Sequence[int]) -> Array | None:
    """Impulse responses (m, 8 order) of a long ARX model; None where they are not finite."""
    inputs = u.shape[1]
    theta = _arx(u, y, order, (order,) * inputs, nk)
    a = reflect_into_disc(theta[None, :order], 0.9999)[0]
    responses = np.zeros((inputs, 8 * order))
    responses[:, :order] = theta[order:].reshape(inputs, order)
    filter_rows(responses, np.append(1.0, a), np.zeros((inputs, order)))
    # So long a polynomial from its roots need not be stable.
    return responses if np.isfinite(responses).all() else None


def reduced_denominator(responses: Array, order: int) -> Array:
    """Common denominator, (order,), of impulse responses (m, L), by Kung (1978).  A singular value
    decomposition of their Hankel matrices."""
    length = responses.shape[1]
    rows = length // 2
    hankel = np.hstack(
        [
            np.lib.stride_tricks.sliding_window_view(each[1:], length - rows)[: rows - 1]
            for each in responses
        ]
    )
    left, singular, _ = np.linalg.svd(hankel, full_matrices=False)
    return _poles_of(left[:, :order] * np.sqrt(singular[:order]), order)


def subspace_denominator(u: Array, y: Array, order: int) -> Array:
    """Denominator by the subspace method MOESP with past inputs and outputs as instruments.
    Verhaegen (1994); (order,)."""
    u = u.reshape(len(y), -1)
    rows = int(np.clip(HANKEL_ROWS * order, order + 2, min(MOST_HANKEL_ROWS, len(y) // 8)))
    columns = len(y) - 2 * rows + 1
    windows = [
        np.lib.stride_tricks.sliding_window_view(signal, columns)[: 2 * rows]
        for signal in (*u.T, y)
    ]
    past, future = [each[:rows] for each in windows], [each[rows:] for each in windows]
    stacked = np.concatenate([*future[:-1], *past, future[-1]])
    lower = np.asarray(np.linalg.qr(stacked.T, mode="r")).T
    of_inputs, before = u.shape[1] * rows, (2 * u.shape[1] + 1) * rows
    left, singular, _ = np.linalg.svd(lower[before:, of_inputs:before], full_matrices=False)
    return _poles_of(left[:, :order] * np.sqrt(singular[:order]), order)


def random_denominators(count: int, order: int, generator: np.random.Generator) -> Array:
    """Polynomials with roots spread over all frequencies and over the damping, (count, order)."""
    coefficients = np.empty((count, order))
    pairs = order // 2
    for row in range(count):
        angles = np.pi * generator.random(pairs)
        radii = 1.0 - FARTHEST * (NEAREST / FARTHEST) ** generator.random(pairs)
        upper = radii * np.exp(1j * angles)
        real = (1.0 - FARTHEST * (NEAREST / FARTHEST) ** generator.random(order % 2)) * (
            generator.choice([-1.0, 1.0], order % 2)
        )
        roots = np.concatenate([upper, upper.conj(), real])
        coefficients[row] = np.atleast_1d(np.real(np.poly(roots)))[1:]
    return coefficients


def noise_model(v: Array, nc: int, nd: int) -> tuple[Array, Array]:
    """C and D of ``D v = C e`` by two least-squares fits (Hannan & Rissanen 1982).  A long
    autoregression gives e, then v is regressed on past v and past e.  ``v`` (N,).  Returns (nc,)
    and (nd,)."""
    long_order = min(max(20, 2 * (nc + nd)), max(len(v) // 10, 1))
    rows, first = _arx_regressors(np.empty((len(v), 0)), v, long_order, (), ())
    e = v[first:] - rows @ _least_squares(rows, v[first:])
    theta = _arx(e[:, None], v[first:], nd, (nc,), (1,))
    return theta[nd:], theta[:nd]


def _arx(u: Array, y: Array, na: int, nb: Sequence[int], nk: Sequence[int]) -> Array:
    """``[a, b_1 ... b_m]`` of the ARX model of least squares, (na + sum(nb),)."""
    if na + sum(nb) == 0:
        return np.empty(0)
    regressors, first = _arx_regressors(u, y, na, nb, nk)
    return _least_squares(regressors, y[first:])


def _arx_regressors(
    u: Array, y: Array, na: int, nb: Sequence[int], nk: Sequence[int]
) -> tuple[Array, int]:
    first = max(na, *(k + n - 1 for k, n in zip(nk, nb, strict=True)), 0)
    columns = [-y[first - i : len(y) - i] for i in range(1, na + 1)]
    for signal, count, delay in zip(u.T, nb, nk, strict=True):
        columns += [signal[first - delay - j : len(y) - delay - j] for j in range(count)]
    return np.column_stack(columns), first


def _least_squares(regressors: Array, target: Array) -> Array:
    if regressors.shape[1] == 0:
        return np.empty(0)
    scale = np.linalg.norm(regressors, axis=0)
    scale[scale == 0.0] = 1.0
    solution: Array = np.linalg.lstsq(regressors / scale, target, rcond=1e-12)[0] / scale
    return solution


def _poles_of(observability: Array, order: int) -> Array:
    """Characteristic polynomial of the shift that an extended observability matrix contains."""
    shift = np.linalg.lstsq(observability[:-1], observability[1:], rcond=None)[0]
    coefficients: Array = np.real(np.poly(shift))[1:]
    return coefficients if len(coefficients) == order else np.zeros(order)


# Places of a section that are tried at a hop.
PLACES = 12
# Distances of a section's roots from the unit circle: as far as a pole that rings for two samples,
# and as near as one that rings for hundreds.
SECTION_FARTHEST, SECTION_NEAREST = 0.4, 0.003


class Sections(NamedTuple):
    """Quadratic factors by the angle of their roots, (m // 2, 2), and the real root left over."""

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
    """Polynomials, (count, m), whose sections each come from one of two parents, by frequency.
    ``polynomials`` (M, m): without the leading 1.  ``pairs`` (2, count): the parents of each."""
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


def random_sections(count: int, generator: np.random.Generator) -> Array:
    """Monic quadratic polynomials, (count, 3), spread over all frequencies and over the damping."""
    angles = np.pi * (np.arange(count) + generator.random(count)) / count
    radii = 1.0 - SECTION_FARTHEST * (SECTION_NEAREST / SECTION_FARTHEST) ** generator.random(count)
    return np.column_stack([np.ones(count), -2.0 * radii * np.cos(angles), radii**2])


def each_without(coefficients: Array) -> Iterator[tuple[Array, Array]]:
    """Each section of a polynomial, (2,), and the polynomial without it, with the leading 1."""
    found = sections_of(coefficients)
    for row, section in enumerate(found.quadratic):
        rest = Sections(np.delete(found.quadratic, row, axis=0), found.single)
        yield section, np.append(1.0, product_of(rest))


def without_nearest(coefficients: Array, section: Array) -> Array | None:
    """A monic polynomial, with the leading 1, without its section nearest to another one.
    ``coefficients`` (m,): without the leading 1.  None where the polynomial has no section."""
    roots_of_section = _section_roots(section)
    nearest = min(
        each_without(coefficients),
        key=lambda each: np.min(np.abs(_section_roots(each[0])[:, None] - roots_of_section)),
        default=None,
    )
    return None if nearest is None else nearest[1]


def without_nearest_of(name: str, coefficients: Array, section: Array) -> Array | None:
    """Coefficients of a polynomial as a point holds them, with the leading one, of B any number,
    without the section nearest to another one."""
    gain = coefficients[0] if name == "b" and len(coefficients) else 1.0
    if gain == 0.0:
        return None
    rest = without_nearest(coefficients[1:] / gain if name == "b" else coefficients, section)
    return None if rest is None else gain * rest


def with_moved_section(
    point: Array,
    lead: slice,
    others: Sequence[tuple[str, slice]],
    generator: np.random.Generator,
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


def _section_roots(section: Array) -> NDArray[np.complex128]:
    half = -0.5 * section[0]
    spread = np.sqrt(complex(half * half - section[1]))
    return np.array([half + spread, half - spread])
