"""Sample autocorrelation and cross-correlation functions, and the period of a signal."""

import numpy as np

from evopem.arrays import Array
from evopem.errors import InputError

# A signal repeats at a lag where its correlation is as large as this, once it has fallen below the
# other; with the opposite sign for odd harmonics alone.
REPEATS, HAS_CHANGED = 0.95, 0.5
# Longest lag as a share of the samples: what overlaps must tell something of the whole.
LONGEST_LAG = 2.0 / 3.0


def autocorrelation(signal: Array, lags: int) -> Array:
    """Biased sample autocorrelation at lags 0 … `lags` < N (Ljung 1999, section 6.1)."""
    return cross_correlation(signal, signal, lags)[lags:]


def cross_correlation(first: Array, second: Array, lags: int) -> Array:
    """Biased sample cross-correlation, ``first`` at time t + k with ``second`` at time t.

    At lags k from -`lags` to `lags` < N. Of residuals with inputs, positive lags hold what the
    model has left unused of past inputs; negative ones show feedback.
    """
    from scipy.signal import correlate

    samples = first.size
    x, y = first - first.mean(), second - second.mean()
    energy = float(np.sqrt(np.dot(x, x)) * np.sqrt(np.dot(y, y)))
    if energy == 0.0:
        raise InputError("correlation", "a signal is constant", "give signals that vary")
    products = correlate(x, y, method="fft")
    return products[samples - 1 - lags : samples + lags] / energy


def repetition_lag(signal: Array) -> int:
    """Samples after which a signal repeats, as it is or with the opposite sign; 0 for none."""
    n = len(signal)
    longest = int(LONGEST_LAG * n)
    x = signal - signal.mean()
    if longest < 2 or not np.ptp(x) > 0.0:
        return 0
    spectrum = np.fft.rfft(x, 2 * n)
    products = np.fft.irfft(np.abs(spectrum) ** 2, 2 * n)[: longest + 1]
    power = np.concatenate([[0.0], np.cumsum(x**2)])
    lags = np.arange(longest + 1)
    scale = np.sqrt(power[n - lags] * (power[n] - power[lags]))
    correlation = np.divide(products, scale, out=np.zeros(longest + 1), where=scale > 0.0)
    changed = np.flatnonzero(np.abs(correlation) < HAS_CHANGED)
    if not len(changed):
        return 0
    repeats = np.abs(correlation) >= REPEATS
    repeats[: changed[0]] = False
    if not repeats.any():
        return 0
    first = int(np.argmax(repeats))
    # The largest correlation of the first lags in sequence that repeat.
    last = first + int(np.argmin(np.append(repeats[first:], False)))
    return first + int(np.argmax(np.abs(correlation[first:last])))
