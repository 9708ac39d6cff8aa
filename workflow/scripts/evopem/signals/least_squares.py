"""Least squares over recordings of any length in blocks of rows, and autoregressions."""

import math
from collections.abc import Iterable, Iterator

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import ArrayLike

from evopem.arrays import Array

CHUNK = 8192
# Rows of up to 200 columns that are reduced at a time: they stay in the cache of a processor.
ROWS = 2**11
WIDTH = 32  # columns of a block, by which LAPACK makes more of its cache


def chunks(start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Neighbouring ranges of at most :data:`CHUNK` samples."""
    for first in range(start, stop, CHUNK):
        yield first, min(first + CHUNK, stop)


def triangle_of(blocks: Iterable[Array]) -> Array:
    """R of the QR decomposition of a matrix that comes in blocks of rows. From 30 to 130 columns
    NumPy's takes twice as long as LAPACK alone."""
    triangle = np.zeros((0, 0))
    for block in blocks:
        rows, n = np.concatenate([triangle, block]) if triangle.size else block, block.shape[1]
        factors = scipy.linalg.lapack.dgeqrf(rows, WIDTH * n)[0] if rows.size else rows
        triangle = np.triu(factors[:n])
    return triangle


def autoregression(signal: ArrayLike, most: int) -> Array:
    """Coefficients ``1, a_1, ...`` of the autoregression of smallest BIC, of order 0 to ``most``.
    ``signal`` (N,): with zero mean; all orders are fitted to the same samples, ten for each lag."""
    x = np.asarray(signal, dtype=float)
    most = min(most, x.size // 10)
    past = np.lib.stride_tricks.sliding_window_view(x, most + 1)[:, ::-1]
    # With the lags in rising order, the leading blocks of one triangle serve all orders.
    parts = (past[first : first + ROWS] for first in range(0, len(past), ROWS))
    triangle = triangle_of(np.roll(part, -1, axis=1) for part in parts)
    remaining = np.cumsum(triangle[::-1, -1] ** 2)[::-1]
    samples = len(past)
    with np.errstate(divide="ignore"):
        criteria = np.log(remaining) + np.arange(most + 1) * math.log(samples) / samples
    order = int(np.argmin(criteria))
    solution = np.linalg.lstsq(triangle[:order, :order], triangle[:order, -1], rcond=None)[0]
    return np.concatenate([[1.0], -solution])
