"""Sample autocorrelations."""

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.errors import InputError


def autocorrelation(signals: Array, lags: int) -> Array:
    """Biased sample autocorrelation at lags 0 … `lags` < N of (..., N) signals, (..., lags + 1).

    As Ljung (1999, section 6.1) has it; InputError where a signal is constant.
    """
    products = products_at_lags(centred(signals), lags)
    if not products[..., 0].all():
        raise InputError("correlation", "a signal is constant", "give signals that vary")
    return np.asarray(products / products[..., :1])


def independent_share(errors: Array) -> float:
    """Share of errors, (N,), that count as independent by their autocorrelation (Bartlett 1946)."""
    if not np.ptp(errors) > 0.0:
        return 1.0
    correlations = autocorrelation(errors, len(errors) // 10)[1:]
    return 1.0 / (1.0 + 2.0 * max(float(np.sum(correlations**2 - 1.0 / len(errors))), 0.0))


def centred(signals: Array) -> Array:
    """(..., N) signals without their mean, times powers of two: no square of small ones is 0."""
    rest = signals - signals.mean(axis=-1, keepdims=True)
    return np.ldexp(rest, -np.frexp(np.max(np.abs(rest), axis=-1, keepdims=True))[1])


def products_at_lags(signals: Array, lags: int) -> Array:
    """Sums of products of (..., N) signals with themselves at lags 0 … `lags`."""
    length = scipy.fft.next_fast_len(signals.shape[-1] + lags, real=True)
    power = np.abs(scipy.fft.rfft(signals, length)) ** 2
    return np.asarray(scipy.fft.irfft(power, length)[..., : lags + 1])
