"""Sample autocorrelation and cross-correlation functions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError


@dataclass(frozen=True)
class Correlation:
    """A normalised correlation function."""

    lags: NDArray[np.int64]  # (M,) in samples
    values: NDArray[np.float64]  # (M,) between -1 and 1


def autocorrelation(signal: NDArray[np.float64], lags: int) -> Correlation:
    """Biased sample autocorrelation at lags 0 … `lags` < N (Ljung 1999, section 6.1)."""
    both = cross_correlation(signal, signal, lags)
    return Correlation(both.lags[lags:], both.values[lags:])


def cross_correlation(
    first: NDArray[np.float64], second: NDArray[np.float64], lags: int
) -> Correlation:
    """Biased sample cross-correlation: ``first`` at time t + k with ``second`` at time t.

    With the residuals first and the input second, positive lags, to `lags` < N, hold what the model
    has left unused of past inputs; negative ones show feedback.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    samples = first.size
    x, y = first - first.mean(), second - second.mean()
    energy = float(np.sqrt(np.dot(x, x)) * np.sqrt(np.dot(y, y)))
    if energy == 0.0:
        raise InputError("correlation", "a signal is constant", "give signals that vary")
    # Zeros beyond the end keep the circular correlation of the transform from wrapping round.
    length = next_fast_len(samples + lags, real=True)
    products = irfft(rfft(x, length) * np.conj(rfft(y, length)), length)
    values = np.concatenate((products[length - lags :], products[: lags + 1])) / energy
    return Correlation(np.arange(-lags, lags + 1), values)
