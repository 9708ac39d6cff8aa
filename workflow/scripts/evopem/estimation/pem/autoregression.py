"""Autoregressions of residuals, of an order chosen by BIC."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def autoregression(signal: ArrayLike, most: int) -> Array:
    """Coefficients ``1, a_1, ...`` of the autoregression of smallest BIC, of order 0 to ``most``.

    Ordinary least squares on one set of samples for all orders.

    ``signal`` (N,): with zero mean.  ``most``: largest order; cut to a tenth of the samples.
    """
    x = np.asarray(signal, dtype=float)
    most = min(most, x.size // 10)
    past = np.lib.stride_tricks.sliding_window_view(x, most + 1)[:, ::-1]
    # With the lags in rising order, the leading blocks of one triangle serve all orders.
    triangle = np.asarray(np.linalg.qr(np.roll(past, -1, axis=1), mode="r"))
    remaining = np.cumsum(triangle[::-1, -1] ** 2)[::-1]
    samples = len(past)
    with np.errstate(divide="ignore"):
        criteria = np.log(remaining) + np.arange(most + 1) * math.log(samples) / samples
    order = int(np.argmin(criteria))
    solution = np.linalg.lstsq(triangle[:order, :order], triangle[:order, -1], rcond=None)[0]
    return np.concatenate([[1.0], -solution])
