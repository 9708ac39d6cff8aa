"""Delays of the inputs, from vector ARX models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

Array = NDArray[np.float64]

# Lags of the outputs, and lags of each input counted from its delay, at most.
OUTPUT_LAGS, INPUT_LAGS = 10, 10
# Rounds over the inputs; the choice hardly ever changes after the first one.
ROUNDS = 3


def estimate_delays(
    inputs: ArrayLike, outputs: ArrayLike, largest: int = 10, smallest: int = 0
) -> tuple[int, ...]:
    """Delay nk of each input in samples, 0 for one that acts on the same sample.

    The largest delay of an input is taken at which the vector ARX model, of a fixed last lag, has
    the lowest BIC: its first lags are left out as long as they explain nothing.

    Parameters
    ----------
    inputs : (N, nu) array_like
    outputs : (N, ny) array_like
    largest, smallest : int
        Delays tried, both included.

    Examples
    --------
    >>> u = np.random.default_rng(1).standard_normal((500, 2))
    >>> y = np.zeros((500, 1))
    >>> y[2:, 0] = u[2:, 0] + u[:-2, 1]
    >>> estimate_delays(u, y + 0.1 * np.random.default_rng(2).standard_normal((500, 1)))
    (0, 2)
    """
    u, y = np.asarray(inputs, dtype=float), np.asarray(outputs, dtype=float)
    samples, nu = u.shape
    last = largest + INPUT_LAGS
    affordable = max((samples // 5 - y.shape[1]) // (nu + y.shape[1]), 1)
    last = min(last, affordable)
    largest = max(min(largest, last - 1), smallest)
    last = max(last, largest + 1)
    output_lags = min(OUTPUT_LAGS, affordable)
    first = max(last, output_lags)
    rows = np.arange(first, samples)
    past = [y[rows - k] for k in range(1, output_lags + 1)]
    lagged = [np.column_stack([u[rows - k, j] for k in range(last + 1)]) for j in range(nu)]
    known = np.column_stack([np.ones(len(rows)), *past])
    with threadpool_limits(limits=1, user_api="blas"):
        delays = [smallest] * nu
        for _ in range(ROUNDS):
            before = list(delays)
            for j in range(nu):
                scores = []
                for delay in range(smallest, largest + 1):
                    trial = [*delays[:j], delay, *delays[j + 1 :]]
                    scores.append(_bic(known, lagged, trial, y[rows]))
                delays[j] = smallest + int(np.argmin(scores))
            if delays == before:
                break
    return tuple(delays)


def _bic(known: Array, lagged: Sequence[Array], delays: Sequence[int], targets: Array) -> float:
    x = np.column_stack([known, *(each[:, nk:] for each, nk in zip(lagged, delays, strict=True))])
    errors = targets - x @ np.linalg.lstsq(x, targets, rcond=None)[0]
    count, ny = targets.shape
    covariance = errors.T @ errors / count
    floor = 1e-14 * np.diag(np.mean(targets**2, axis=0) + np.finfo(float).tiny)
    log_determinant = np.linalg.slogdet(covariance + floor)[1]
    return float(log_determinant + x.shape[1] * ny * np.log(count) / count)
