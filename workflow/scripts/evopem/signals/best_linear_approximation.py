"""Spectra of the periods of periodic signals, and the best linear approximation of a response.

Of a nonlinear system that a periodic input of random phases drives, it is the linear system nearest
to the response in the mean over the phases; what is left looks like noise that repeats with the
period (Pintelon & Schoukens 2012, "System Identification", chapters 3 and 4).
"""

import numpy as np
from scipy.sparse import csr_array

from evopem.arrays import Array, Complex, Flags
from evopem.signals.faulty_samples import runs_of
from evopem.signals.spectra import line_weights, overlapping_correlation, repetition_lag

UNLIKE = 0.1  # periods of an input are alike up to this share of their standard deviation
# Noise is as unlike after two periods as after one; what is not belongs to a period between two
# numbers of samples, unless it is this share of what is allowed.
SHIFTED = 0.1
# Correlation after a period of realisations that follow each other, of two periods each at least,
# and peaks of it that are tried.
OFTEN, MOST_PEAKS = 0.3, 20
# Sorted by power, excited lines end where the next line has this share of the power or less.
DROP = 0.1
# Ratio of the variances between periods of one realisation, and rounding as a share of the power.
AS_ALIKE, ROUNDING = 4.0, 1e-9
SAME = 0.9  # circular correlation from which on two periods are of one realisation


def period_of(inputs: Array) -> int:
    """Samples after which all inputs, (N, m), repeat; 0 where they do not, or have no variation."""
    varying = inputs[:, np.ptp(inputs, axis=0) > 0.0]
    if not varying.size:
        return 0
    lag = repetition_lag(varying[:, 0])
    if not lag:
        return 0
    allowed = 2.0 * UNLIKE**2 * np.var(varying, axis=0)
    for period in (lag, 2 * lag):
        if len(varying) < 2 * period:
            return 0
        once, twice = (varying[k:] - varying[:-k] for k in (period, 2 * period))
        change = np.mean(once**2, axis=0)
        if (change <= allowed).all():
            later = np.sum(twice**2, axis=0) / max(len(twice), 1)
            shifted = (later > 2.0 * change) & (change > SHIFTED**2 * allowed)
            return 0 if shifted.any() else period
    return 0


def realisations_of(inputs: Array) -> tuple[int, list[slice]]:
    """The period of inputs, (N, m), and the samples of each realisation; 0 and none without one.

    Where realisations follow each other, half the samples at least are of one with two periods.
    """
    if period := period_of(inputs):
        return period, [slice(0, len(inputs))]
    varying = inputs[:, np.ptp(inputs, axis=0) > 0.0]
    if not varying.size:
        return 0, []
    alike = np.abs(overlapping_correlation(varying[:, 0]))
    peaks = np.flatnonzero(
        (alike[1:-1] >= np.maximum(alike[:-2], alike[2:])) * alike[1:-1] >= OFTEN
    )
    for near in 1 + peaks[np.argsort(-alike[1 + peaks])[:MOST_PEAKS]]:
        if parts := _repeating(varying, int(near)):
            period = period_of(varying[parts[0]])
            parts = _repeating(varying, period)
            if 2 * sum(part.stop - part.start for part in parts) >= len(inputs):
                return period, parts
    return 0, []


def _repeating(signals: Array, period: int) -> list[slice]:
    """Samples of signals, (N, m), that repeat over two periods or more. Up to the first and last
    two periods that are as alike as those between."""
    if not 0 < 2 * period <= len(signals):
        return []
    change = np.sum((signals[period:] - signals[:-period]) ** 2 / np.var(signals, axis=0), axis=1)
    sums = np.cumsum(np.insert(change, 0, 0.0))
    unlike = (sums[period:] - sums[:-period]) / period + ROUNDING
    parts = []
    for first, end in runs_of(unlike <= 2.0 * UNLIKE**2 * signals.shape[1]):
        alike = first + np.flatnonzero(unlike[first:end] <= AS_ALIKE * unlike[first:end].min())
        parts.append(slice(int(alike[0]), int(alike[-1]) + 2 * period))
    return parts


def spectra_of_periods(signals: Array, period: int) -> Complex:
    """Fourier coefficients of the last whole periods of signals, (N, c), as (P, F, c).

    Lines 0 … T/2 of T samples; :func:`.line_weights` times the squared modulus is power.
    """
    count = len(signals) // period
    parts = signals[len(signals) - count * period :].reshape(count, period, -1)
    return np.asarray(np.fft.rfft(parts, axis=1) / period)


def excited_lines(inputs: Complex) -> Flags:
    """Lines with the power of an input, (F,), of spectra (M, F, m); never line 0.

    They are those above the first large drop of the sorted powers.
    """
    power = np.mean(np.abs(inputs) ** 2, axis=0)
    excited = np.zeros(len(power), dtype=bool)
    for of_input in power.T:
        levels = np.sort(of_input[1:])[::-1]
        drops = np.flatnonzero(levels[1:] <= DROP * levels[:-1])
        least = levels[drops[0]] if len(drops) else levels[-1]
        excited[1:] |= (of_input[1:] >= least) & (of_input[1:] > 0.0)
    return excited


def same_realisation(first: Complex, second: Complex, period: int) -> bool:
    """Whether periods with these spectra, (F, m), are one another, shifted or of opposite sign."""
    products = first[1:] * second[1:].conj()
    alike = np.fft.irfft(np.concatenate([[0.0], products.sum(axis=1)]), period) * period
    weights = line_weights(period)[1:, None]
    norms = [np.sqrt(np.sum(weights * np.abs(x[1:]) ** 2)) for x in (first, second)]
    return bool(np.max(np.abs(alike)) >= SAME * norms[0] * norms[1])


def best_linear_approximation(inputs: Complex, outputs: Complex) -> tuple[Complex, Array]:
    """Best linear approximation from spectra of M realisations over P periods at E lines.

    Inputs (M, P, E, m), M >= m, and outputs (M, P, E, l).  Least squares over the realisations:
    the mean of the responses where these have inputs of the same power.  Returns them, (E, l, m),
    and the variance, (E, l), that noise and nonlinear distortion give the mean of the periods of a
    realisation; NaN where there are no more realisations than inputs.
    """
    realisations, _, _, m = inputs.shape
    u = np.moveaxis(inputs.mean(axis=1), 0, 2)  # (E, m, M)
    y = np.moveaxis(outputs.mean(axis=1), 0, 2)
    response = y @ np.linalg.pinv(u)
    left = np.sum(np.abs(y - response @ u) ** 2, axis=2)
    total = left / (realisations - m) if realisations > m else np.full(left.shape, np.nan)
    return response, total


def interpolated_lines(known: Flags, others: Flags) -> csr_array:
    """Weights, (F, F), that take values at known lines to others: linear, the nearest beyond."""
    at, places = np.flatnonzero(others), np.flatnonzero(known)
    position = np.interp(at, places, np.arange(len(places)))
    lower = np.floor(position).astype(int)
    share = position - lower
    columns = places[np.concatenate([lower, np.minimum(lower + 1, len(places) - 1)])]
    values = np.concatenate([1.0 - share, share])
    return csr_array((values, (np.tile(at, 2), columns)), shape=2 * known.shape)
