"""Multitaper spectra, the responses and coherence of channels; cross-correlations.

Sources: Thomson, D. J. (1982), "Spectrum estimation and harmonic analysis", Proc. IEEE 70;
Percival & Walden (1993), "Spectral Analysis for Physical Applications", chapter 7; Bendat &
Piersol (2010), "Random Data", section 7.4 and chapter 9; Carter (1987).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import NDArray

from evopem.arrays import Array, Complex
from evopem.errors import InputError
from evopem.signals.correlation import centred, products_at_lags
from evopem.signals.recording import Recording

CONFIDENCE = 0.95

# Bound on the iterations of the adaptive weights, which nearly always converge in about ten.
MAX_WEIGHT_ITERATIONS = 500


def line_weights(period: int) -> Array:
    """Shares of the squared coefficients at lines 0 … T/2 in the mean square of a signal, (F,)."""
    weights = np.full(period // 2 + 1, 2.0)
    weights[0] = 1.0
    if period % 2 == 0:
        weights[-1] = 1.0
    return weights


@dataclass(frozen=True)
class Spectrum:
    """One-sided power spectral density with its 95 % confidence band."""

    frequencies: Array  # Hz, from 0 to the Nyquist frequency
    # unit² / Hz; the density's sum times the frequency step is the signal's variance
    density: Array
    degrees_of_freedom: Array  # of the chi-square distribution behind the band
    time_halfbandwidth: float  # NW
    tapers: int  # K = 2NW - 1
    nfft: int  # length of the transforms
    segments: int  # segments of the signal; 1 unless it is longer than `nfft`
    halfbandwidth_hz: float  # W: the density at a frequency is an average over ± W

    @property
    def resolution_hz(self) -> float:
        """Smallest distance (Hz) at which two lines are resolved: 2W."""
        return 2.0 * self.halfbandwidth_hz

    @cached_property
    def lower(self) -> Array:
        """Lower end of the 95 % band."""
        return self._end((1.0 + CONFIDENCE) / 2.0)

    @cached_property
    def upper(self) -> Array:
        """Upper end of the band."""
        return self._end((1.0 - CONFIDENCE) / 2.0)

    def _end(self, probability: float) -> Array:
        freedom = self.degrees_of_freedom
        return self.density * freedom / scipy.stats.chi2.ppf(probability, freedom)


def multitaper_spectrum(
    signal: Array, sampling_rate: float, time_halfbandwidth: float = 4.0, nfft: int = 8192
) -> Spectrum:
    """Thomson's adaptive multitaper estimate of the power spectral density, without the mean.

    A signal of more than `nfft` samples is divided into the fewest equal segments of at most
    `nfft`, whose eigenspectra are averaged: every segment narrows the band. K = 2NW - 1 tapers of
    `time_halfbandwidth` NW have the adaptive weights of Percival & Walden (1993, eq. 368a); the
    chi-square band covers the variance, not the bias of a peak narrower than W. The density is
    scaled (by a few per cent at most for a stationary signal) so that its integral equals the
    variance.
    """
    spectra = _spectra([signal[:, None]], sampling_rate, time_halfbandwidth, nfft)
    # Both sides of the spectrum; zero and Nyquist stand alone.
    density = line_weights(nfft) * spectra.matrices[:, 0, 0].real
    density *= float(spectra.variances[0]) / (density.sum() * sampling_rate / nfft)
    return Spectrum(
        frequencies=spectra.frequencies,
        density=density,
        degrees_of_freedom=spectra.freedom,
        time_halfbandwidth=float(time_halfbandwidth),
        tapers=spectra.tapers,
        nfft=nfft,
        segments=spectra.segments,
        halfbandwidth_hz=spectra.halfbandwidth_hz,
    )


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Empirical frequency responses from m inputs to l outputs, at F frequencies."""

    frequencies: Array  # (F,), Hz
    response: Complex  # (F, l, m), the H1 estimate (output unit / input unit)
    gain_lower: Array  # (F, l, m), 95 % band of its modulus
    gain_upper: Array
    coherence: Array  # (F, l), multiple squared coherence of an output with all inputs, 0 to 1
    degrees_of_freedom: Array  # (F,), twice the number of independent estimates behind each value

    @property
    def gain(self) -> Array:
        """Modulus of the response, (F, l, m)."""
        return np.abs(self.response)

    @property
    def phase_deg(self) -> Array:
        """Phase of the response in (-180, 180], (F, l, m)."""
        return np.degrees(np.angle(self.response))

    def coherence_limit(self, probability: float) -> Array:
        """What the coherence of independent signals exceeds with a probability, (F,).

        Of n independent estimates it has the beta distribution of m and n - m (Carter 1987).  NaN
        where there are no more than m estimates.
        """
        inputs, estimates = self.response.shape[2], self.degrees_of_freedom / 2.0
        rest = np.maximum(estimates - inputs, np.finfo(float).tiny)
        limit = scipy.stats.beta.isf(probability, inputs, rest)
        return np.where(estimates > inputs, limit, np.nan)


def frequency_response(
    recording: Recording, time_halfbandwidth: float = 4.0, nfft: int = 8192
) -> FrequencyResponse:
    """Frequency responses and coherence of all channels from their multitaper cross-spectra.

    H1 = S_yu S_uu^-1: unbiased by noise on the outputs, pulled towards zero by noise on the inputs.
    The weights are common to all spectra, so the coherence never exceeds 1. The band of the gain is
    Student's, with ν - 2m degrees of freedom: ``|H_ij| ± t sqrt((S_uu^-1)_jj S_yy,i (1 - γ_i²) / (ν
    - 2m))`` (Bendat & Piersol 2010, section 9.2, for the modulus alone), cut off at 0.
    """
    inputs = recording.inputs.shape[1]
    parts = [s for s in recording.segments if s.samples > 2.0 * time_halfbandwidth]
    signals = [np.column_stack([part.inputs, part.outputs]) for part in parts or recording.segments]
    estimates = _spectra(signals, recording.sampling_rate, time_halfbandwidth, nfft)
    if estimates.tapers * estimates.segments < 2:
        problem = f"{time_halfbandwidth:g} gives a single taper, and a coherence needs two"
        raise InputError("spectrum: time_halfbandwidth", problem, "choose at least 1.5")
    spectra, freedom = estimates.matrices, estimates.freedom
    s_uu, s_yu = spectra[:, :inputs, :inputs], spectra[:, inputs:, :inputs]
    s_yy = np.einsum("fii->fi", spectra)[:, inputs:].real
    inverse = np.linalg.pinv(s_uu, rcond=1e-10, hermitian=True)
    response = s_yu @ inverse
    explained = np.einsum("fij,fij->fi", response, s_yu.conj()).real
    coherence = np.clip(explained / s_yy, 0.0, 1.0)
    # At zero and Nyquist the coefficients are real and the count is halved; keep one free.
    residual_freedom = np.maximum(freedom - 2.0 * inputs, 1.0)
    quantile = scipy.stats.t.ppf(0.5 + CONFIDENCE / 2.0, residual_freedom)
    left = s_yy * (1.0 - coherence) * (quantile**2 / residual_freedom)[:, None]
    radius = np.sqrt(left[:, :, None] * np.einsum("fii->fi", inverse).real[:, None, :])
    gain = np.abs(response)
    ends = np.maximum(gain - radius, 0.0), gain + radius
    return FrequencyResponse(estimates.frequencies, response, *ends, coherence, freedom)


class _Spectra(NamedTuple):
    """Spectral matrices of c channels at F frequencies."""

    matrices: Complex  # (F, c, c), two-sided
    variances: Array  # (c,)
    freedom: Array  # (F,) degrees of freedom, Percival & Walden (1993, eq. 370b)
    frequencies: Array  # (F,)
    tapers: int
    segments: int
    halfbandwidth_hz: float  # of the longest segments


def _spectra(
    signals: Sequence[Array], rate: float, time_halfbandwidth: float, nfft: int
) -> _Spectra:
    """Spectral matrices from segments, (n, c) each, weighted alike in all channels. Their weights
    are the geometric mean of the channels' adaptive weights."""
    signals = [signal - signal.mean(axis=0) for signal in signals]
    variances = np.concatenate(signals).var(axis=0)
    if not variances.all():
        raise InputError("spectrum", "a signal is constant", "choose channels that vary")
    channels = len(variances)
    frequencies = np.asarray(np.fft.rfftfreq(nfft, 1.0 / rate), np.float64)
    products: NDArray[Any] = np.zeros(())
    longest, segments = 0, 0
    for signal in signals:
        count = max(-(-len(signal) // nfft), 1)
        length = len(signal) // count
        sequences, ratios = _tapers(length, time_halfbandwidth)
        if length > longest:
            longest, concentrations = length, ratios
        segments += count
        for segment in signal[: count * length].reshape(count, length, channels):
            # Eigencoefficients: transforms of the tapered segment, (K, F, c).
            transformed = np.fft.rfft(sequences[:, :, None] * segment, nfft, axis=1)
            products = products + transformed[..., :, None] * transformed[..., None, :].conj()
    products /= segments * rate
    of_channels = [
        _adaptive_weights(products[:, :, k, k].real, concentrations, variances[k] / rate)
        for k in range(channels)
    ]
    weights = np.exp(np.mean(np.log(of_channels), axis=0)) if channels > 1 else of_channels[0]
    # Real coefficients have half the freedom of complex ones.
    freedom = line_weights(nfft) * segments * weights.sum(axis=0) ** 2 / (weights**2).sum(axis=0)
    averaged = _weighted_average(weights[..., None, None], products)
    halfbandwidth = time_halfbandwidth * rate / longest
    tapers = len(concentrations)
    return _Spectra(averaged, variances, freedom, frequencies, tapers, segments, halfbandwidth)


@lru_cache(4)
def _tapers(length: int, time_halfbandwidth: float) -> tuple[Array, Array]:
    """2NW - 1 sequences of unit energy, (K, length), and the share of each within its band."""
    tapers = int(2 * time_halfbandwidth - 1)
    if tapers < 1:
        problem = f"{time_halfbandwidth:g} leaves no taper"
        remedy = "choose at least 1; 4 is usual"
        raise InputError("spectrum: time_halfbandwidth", problem, remedy)
    if length <= 2 * time_halfbandwidth:
        raise InputError(
            "spectrum",
            f"segments of {length} samples are too short for a time-halfbandwidth of"
            f" {time_halfbandwidth:g}",
            "choose a larger nfft or a smaller time_halfbandwidth, or give more samples",
        )
    dpss = scipy.signal.windows.dpss
    sequences, ratios = dpss(length, time_halfbandwidth, Kmax=tapers, return_ratios=True)
    # Rounding may give a share of 1 or more, but some leakage always remains.
    return sequences, np.minimum(ratios, 1.0 - np.finfo(np.float64).eps)


def _adaptive_weights(eigenspectra: Array, concentrations: Array, flat_density: float) -> Array:
    """Thomson's weights b_k² λ_k, shape (K, F), Percival & Walden (1993, eq. 368a). A taper counts
    less wherever its leakage, at most (1 - λ_k) times the variance, outweighs the density. The
    factor S², common to the tapers of one frequency, cancels and is left out."""
    if len(concentrations) == 1:
        return np.ones_like(eigenspectra)
    # In units of about the flat density: a square of the density itself may leave the range of
    # numbers. A power of two changes no other bit.
    _, exponent = np.frexp(flat_density)
    eigenspectra = np.ldexp(eigenspectra, -exponent)
    kept = concentrations[:, np.newaxis]
    leaked = (1.0 - kept) * np.ldexp(flat_density, -exponent)
    density = eigenspectra[:2].mean(axis=0)
    for _ in range(MAX_WEIGHT_ITERATIONS):
        weights = kept / (kept * density + leaked) ** 2
        previous, density = density, _weighted_average(weights, eigenspectra)
        if np.all(np.abs(density - previous) <= 1e-9 * density):
            break
    return weights


def _weighted_average(weights: Array, values: NDArray) -> NDArray:
    return (weights * values).sum(axis=0) / weights.sum(axis=0)


# A signal repeats at a lag where its correlation is as large as this, once it has fallen below the
# other; with the opposite sign for odd harmonics alone.
REPEATS, HAS_CHANGED = 0.95, 0.5
# Longest lag as a share of the samples: what overlaps must tell something of the whole.
LONGEST_LAG = 2.0 / 3.0


def cross_correlation(first: Array, second: Array, lags: int) -> Array:
    """Biased sample cross-correlation, ``first`` at time t + k with ``second`` at time t.

    At lags k from -`lags` to `lags` < N. Of residuals with inputs, positive lags hold what the
    model has left unused of past inputs; negative ones show feedback.
    """
    samples = first.size
    x, y = centred(first), centred(second)
    energy = float(np.sqrt(np.dot(x, x)) * np.sqrt(np.dot(y, y)))
    if energy == 0.0:
        raise InputError("correlation", "a signal is constant", "give signals that vary")
    # As scipy.signal does, whose import takes longer than all correlations of a recording.
    length = scipy.fft.next_fast_len(2 * samples - 1, real=True)
    both = scipy.fft.rfft(x, length) * scipy.fft.rfft(y[::-1], length)
    return np.asarray(scipy.fft.irfft(both, length)[samples - 1 - lags : samples + lags] / energy)


def repetition_lag(signal: Array) -> int:
    """Samples after which a signal repeats, as it is or with the opposite sign; 0 for none."""
    correlation = overlapping_correlation(signal)
    repeats = np.abs(correlation) >= REPEATS
    if not repeats.any():
        return 0
    first = int(np.argmax(repeats))
    # The largest correlation of the first lags in sequence that repeat.
    last = first + int(np.argmin(np.append(repeats[first:], False)))
    return first + int(np.argmax(np.abs(correlation[first:last])))


def goes_on(signal: Array, lag: int) -> bool:
    """Whether a signal that repeats after a lag does so over three quarters of its samples.

    Narrow-band noise is like itself a period later, but not many.
    """
    longest = 3 * len(signal) // (4 * lag) * lag
    if longest < 2 * lag:
        return False
    alike = np.corrcoef(signal[longest:], signal[: len(signal) - longest])[0, 1]
    return bool(abs(alike) >= REPEATS)


def overlapping_correlation(signal: Array) -> Array:
    """Correlation of what overlaps at each lag; 0 before it first falls below HAS_CHANGED."""
    n = len(signal)
    longest = int(LONGEST_LAG * n)
    if longest < 2 or not np.ptp(signal) > 0.0:
        return np.zeros(1)
    x = signal - signal.mean()
    power = np.concatenate([[0.0], np.cumsum(x**2)])
    lags = np.arange(longest + 1)
    scale = np.sqrt(power[n - lags] * (power[n] - power[lags]))
    correlation = np.zeros(longest + 1)
    np.divide(products_at_lags(x, longest), scale, out=correlation, where=scale > 0.0)
    changed = np.flatnonzero(np.abs(correlation) < HAS_CHANGED)
    correlation[: changed[0] if len(changed) else None] = 0.0
    return correlation
