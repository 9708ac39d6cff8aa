"""Polynomials that descents start from, by linear algebra on one recording of inputs u (N, m)."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from hashlib import sha256

import numpy as np

from evopem.arrays import Array
from evopem.estimation.pem.kernels.polynomials import filter_rows
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.models.orders import Orders
from evopem.models.polynomial_roots import reflect_into_disc, roots
from evopem.signals.least_squares import chunks, triangle_of

STEIGLITZ_MCBRIDE_STEPS = 20
# Rows of block Hankel matrices, in orders of the model, and the most of them.
HANKEL_ROWS, MOST_HANKEL_ROWS = 3, 40
# A recording is finely sampled where half of the power of its output lies below this share of all
# frequencies.  Samples of a block that means are taken of, and least blocks for each pole.
FINE, BLOCK, BLOCKS = 1.0 / 16.0, 4, 20
# Lists of what structures that share their orders need once, empty at first.
_KNOWN = lru_cache(maxsize=256)(lambda *_: list[Array]())


def common_denominators(errors: PolynomialErrors) -> Iterator[Array]:
    """Denominators for all inputs of the longest stretch, (max(na, nf_i),) each."""
    u, y, o = errors.inputs, errors.output, errors.orders
    order = max(o.na, *o.nf, 0)
    signals = sha256(u.tobytes() + y.tobytes()).digest()
    known = _KNOWN(signals, order, o.nb, o.nk, errors.plant_radius)
    if not known:
        known.append(arx(u, y, order, o.nb, o.nk)[:order] if order else np.empty(0))
    yield known[0]
    if len(known) == 1 and order and o.inputs:
        with suppress(np.linalg.LinAlgError, ValueError):
            known.extend(_of_dynamics(u, y, o, order, errors.plant_radius))
    yield from known[1:]


def _of_dynamics(u: Array, y: Array, o: Orders, order: int, radius: float) -> Iterator[Array]:
    # A constant part of the signals is no part of the dynamics that these methods look for.
    u, y = u - np.mean(u, axis=0), y - np.mean(y)
    yield arx(u, y, order, o.nb, o.nk)[:order]
    for multiple in (2, 4):
        if (longer := multiple * order) <= len(y) // 10:
            responses = long_arx_responses(u, y, longer, o.nk)
            yield np.zeros(order) if responses is None else reduced_denominator(responses, order)
    yield from list(steiglitz_mcbride(u, y, order, o.nb, o.nk, radius))[-1:]
    yield subspace_denominator(u, y, order)


def slow_denominators(errors: PolynomialErrors) -> Iterator[Array]:
    """The same of a finely sampled record, from means of blocks of samples, and of blocks of these.
    Of the samples themselves the noise at high frequencies hides poles near 1."""
    u, y, o = errors.inputs, errors.output, errors.orders
    order, factor = max(o.na, *o.nf, 0), 1
    u, y = u - np.mean(u, axis=0), y - np.mean(y)
    while o.inputs and order and len(y) >= BLOCKS * BLOCK * order and _is_fine(y):
        whole, factor = len(y) // BLOCK, BLOCK * factor
        u, y = (s[: BLOCK * whole].reshape(whole, BLOCK, -1).mean(axis=1) for s in (u, y))
        y = y[:, 0]
        nb, nk = tuple(n + 1 for n in o.nb), tuple(k // factor for k in o.nk)
        slower = replace(o, nb=nb, nk=nk)
        with suppress(np.linalg.LinAlgError, ValueError):
            for denominator in _of_dynamics(u, y, slower, order, errors.plant_radius):
                poles = roots(denominator)
                # A negative pole has no real root.
                slow = np.where(poles.imag == 0.0, np.abs(poles), poles) ** (1.0 / factor)
                yield np.real(np.poly(slow))[1:]


def _is_fine(y: Array) -> bool:
    powers = np.cumsum(np.abs(np.fft.rfft(y)) ** 2)
    return bool(np.searchsorted(powers, 0.5 * powers[-1]) < FINE * len(powers))


def own_denominators(errors: PolynomialErrors) -> Iterator[list[Array]]:
    """F_i of each input alone, (nf_i,) each, from the responses of long ARX models."""
    u, y, o = errors.inputs, errors.output, errors.orders
    u, y = u - np.mean(u, axis=0), y - np.mean(y)
    for multiple in (2, 4, 8):
        if (longer := multiple * max(o.nf)) > len(y) // 10:
            continue
        responses = long_arx_responses(u, y, longer, o.nk)
        if responses is not None:
            pairs = zip(responses, o.nf, strict=True)
            yield [reduced_denominator(polynomial[None], nf) for polynomial, nf in pairs]


def steiglitz_mcbride(
    u: Array, y: Array, order: int, nb: Sequence[int], nk: Sequence[int], radius: float
) -> Iterator[Array]:
    """Denominators of the iteration by Steiglitz & McBride (1965), one a step, (order,) each.  ARX
    models of inputs and output, all filtered through the denominator before."""
    denominator = np.zeros(order)
    for _ in range(STEIGLITZ_MCBRIDE_STEPS):
        filtered = np.stack([*u.T, y])
        filter_rows(filtered, np.append(1.0, denominator), np.zeros((len(filtered), order)))
        updated = arx(filtered[:-1].T, filtered[-1], order, nb, nk)[:order]
        if not np.isfinite(updated).all():
            return
        denominator = reflect_into_disc(updated[None, :], radius)[0]
        yield denominator


def long_arx_responses(u: Array, y: Array, order: int, nk: Sequence[int]) -> Array | None:
    """Impulse responses (m, 8 order) of a long ARX model; None where they are not finite."""
    inputs = u.shape[1]
    theta = arx(u, y, order, (order,) * inputs, nk)
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
            np.lib.stride_tricks.sliding_window_view(response[1:], length - rows)[: rows - 1]
            for response in responses
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
    past, future = [window[:rows] for window in windows], [window[rows:] for window in windows]
    stacked = np.concatenate([*future[:-1], *past, future[-1]])
    lower = np.asarray(np.linalg.qr(stacked.T, mode="r")).T
    of_inputs, before = u.shape[1] * rows, (2 * u.shape[1] + 1) * rows
    left, singular, _ = np.linalg.svd(lower[before:, of_inputs:before], full_matrices=False)
    return _poles_of(left[:, :order] * np.sqrt(singular[:order]), order)


def noise_model(v: Array, nc: int, nd: int) -> tuple[Array, Array]:
    """C (nc,) and D (nd,) of ``D v = C e`` by two least-squares fits (Hannan & Rissanen 1982).  A
    long autoregression gives e, then v, (N,), is regressed on past v and past e."""
    long_order = min(max(20, 2 * (nc + nd)), max(len(v) // 10, 1))
    a = arx(np.empty((len(v), 0)), v, long_order, (), ())
    e = np.convolve(np.append(1.0, a), v)[long_order : len(v)]
    theta = arx(e[:, None], v[long_order:], nd, (nc,), (1,))
    return theta[nd:], theta[:nd]


def arx(u: Array, y: Array, na: int, nb: Sequence[int], nk: Sequence[int]) -> Array:
    """``[a, b_1 ... b_m]`` of the ARX model of least squares, (na + sum(nb),)."""
    if na + sum(nb) == 0:
        return np.empty(0)
    start = max(na, *(k + n - 1 for k, n in zip(nk, nb, strict=True)), 0)

    def rows(first: int, stop: int) -> Array:
        columns = [-y[first - i : stop - i] for i in range(1, na + 1)]
        for signal, count, delay in zip(u.T, nb, nk, strict=True):
            columns += [signal[first - delay - j : stop - delay - j] for j in range(count)]
        # Column by column, as the decomposition reads it.
        return np.stack([*columns, y[first:stop]]).T

    triangle = triangle_of(rows(*chunk) for chunk in chunks(start, len(y)))
    regressors, target = triangle[:, :-1], triangle[:, -1]
    scale = np.linalg.norm(regressors, axis=0)
    scale[scale == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(regressors / scale, target, rcond=1e-12)[0] / scale)


def _poles_of(observability: Array, order: int) -> Array:
    """Characteristic polynomial of the shift that an extended observability matrix contains."""
    shift = np.linalg.lstsq(observability[:-1], observability[1:], rcond=None)[0]
    coefficients: Array = np.real(np.poly(shift))[1:]
    return coefficients if len(coefficients) == order else np.zeros(order)
