"""Denominators and noise models from which descents of a polynomial model start.

All of them are estimates by linear algebra on one record.  They give the coefficients of F (or A),
C and D alone; numerator, level and states follow by linear least squares.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.filtering import filter_rows
from evopem.models.polynomials import reflect_into_disc

Array = NDArray[np.float64]

# Distances of random roots from the unit circle: as far as a pole that decays in a sample, and as
# near as one that rings for hundreds.
FARTHEST, NEAREST = 0.9, 0.003
STEIGLITZ_MCBRIDE_STEPS = 20
# Rows of block Hankel matrices, in orders of the model, and the most of them.
HANKEL_ROWS, MOST_HANKEL_ROWS = 3, 40


def arx_denominator(u: Array, y: Array, order: int, nb: int, nk: int) -> Array:
    """A of the ARX model of least squares, (order,)."""
    return _arx(u, y, order, nb, nk)[:order]


def steiglitz_mcbride(
    u: Array, y: Array, order: int, nb: int, nk: int, radius: float
) -> Iterator[Array]:
    """Denominators of the iteration by Steiglitz & McBride (1965), one a step, (order,) each.

    ARX models of input and output, both filtered through the denominator before.
    """
    denominator = np.zeros(order)
    for _ in range(STEIGLITZ_MCBRIDE_STEPS):
        filtered = np.stack([u, y])
        filter_rows(filtered, np.concatenate([[1.0], denominator]), np.zeros((2, order)))
        found = _arx(filtered[0], filtered[1], order, nb, nk)[:order]
        if not np.isfinite(found).all():
            return
        denominator = reflect_into_disc(found[None, :], radius)[0]
        yield denominator


def reduced_arx_denominator(u: Array, y: Array, order: int, long_order: int, nk: int) -> Array:
    """Denominator of a long ARX model's plant, reduced by a singular value decomposition.

    The Hankel matrix of its impulse response gives the poles (Kung 1978), (order,).
    """
    theta = _arx(u, y, long_order, long_order, nk)
    a = reflect_into_disc(theta[None, :long_order], 0.9999)[0]
    length = 8 * long_order
    response = np.zeros((1, length))
    response[0, :long_order] = theta[long_order:]
    filter_rows(response, np.concatenate([[1.0], a]), np.zeros((1, long_order)))
    response = response[0]
    if not np.isfinite(response).all():
        return np.zeros(order)  # so long a polynomial from its roots need not be stable
    rows = length // 2
    hankel = np.lib.stride_tricks.sliding_window_view(response[1:], length - rows)[: rows - 1]
    left, singular, _ = np.linalg.svd(hankel, full_matrices=False)
    observability = left[:, :order] * np.sqrt(singular[:order])
    return _poles_of(observability, order)


def subspace_denominator(u: Array, y: Array, order: int) -> Array:
    """Denominator by the subspace method MOESP with past inputs and outputs as instruments.

    Verhaegen (1994); (order,).
    """
    rows = int(np.clip(HANKEL_ROWS * order, order + 2, min(MOST_HANKEL_ROWS, len(y) // 8)))
    columns = len(y) - 2 * rows + 1
    windows = [
        np.lib.stride_tricks.sliding_window_view(signal, columns)[: 2 * rows] for signal in (u, y)
    ]
    past_u, future_u = windows[0][:rows], windows[0][rows:]
    past_y, future_y = windows[1][:rows], windows[1][rows:]
    stacked = np.concatenate([future_u, past_u, past_y, future_y])
    lower = np.asarray(np.linalg.qr(stacked.T, mode="r")).T
    block = lower[3 * rows :, rows : 3 * rows]
    left, singular, _ = np.linalg.svd(block, full_matrices=False)
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
    """C and D of ``D v = C e`` by two least-squares fits (Hannan & Rissanen 1982).

    A long autoregression gives e, then v is regressed on past v and past e.

    Parameters
    ----------
    v : (N,) array
    nc, nd : int

    Returns
    -------
    (nc,) and (nd,) arrays
    """
    long_order = min(max(20, 2 * (nc + nd)), max(len(v) // 10, 1))
    rows = _lagged(v, long_order, 1)
    e = np.zeros_like(v)
    e[long_order:] = v[long_order:] - rows @ _least_squares(rows, v[long_order:])
    first = long_order + max(nc, nd)
    regressors = np.column_stack(
        [-v[first - k : len(v) - k] for k in range(1, nd + 1)]
        + [e[first - k : len(v) - k] for k in range(1, nc + 1)]
    )
    theta = _least_squares(regressors, v[first:])
    return theta[nd:], theta[:nd]


def _arx(u: Array, y: Array, na: int, nb: int, nk: int) -> Array:
    """``[a, b]`` of the ARX model of least squares, (na + nb,)."""
    if na + nb == 0:
        return np.empty(0)
    first = max(na, nk + nb - 1, 0)
    regressors = np.column_stack(
        [-y[first - i : len(y) - i] for i in range(1, na + 1)]
        + [u[first - nk - j : len(y) - nk - j] for j in range(nb)]
    )
    return _least_squares(regressors, y[first:])


def _lagged(signal: Array, count: int, shortest: int) -> Array:
    """Columns ``signal[t - shortest - j]``, t from ``count + shortest - 1`` on."""
    first = count + shortest - 1
    return np.column_stack(
        [signal[first - shortest - j : len(signal) - shortest - j] for j in range(count)]
    )


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
