"""Multitaper spectra: density, frequency response and coherence with their 95 % bands.

Sources: Thomson, D. J. (1982), "Spectrum estimation and harmonic analysis", Proc. IEEE 70;
Percival & Walden (1993), "Spectral Analysis for Physical Applications", chapter 7;
Bendat & Piersol (2010), "Random Data", chapter 9.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError

Floats = NDArray[np.float64]

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Spectrum:
    """One-sided power spectral density with its 95 % confidence band.

    Attributes
    ----------
    frequencies : ndarray, shape (nfft // 2 + 1,)
        Hz, from 0 to the Nyquist frequency.
    density, lower, upper : ndarray, same shape
        Unit² / Hz; the density's sum times the frequency step is the signal's variance.
    degrees_of_freedom : ndarray, same shape
        Of the chi-square distribution behind the band.
    time_halfbandwidth : float
        NW.
    tapers : int
        K = 2NW - 1.
    nfft : int
        Length of the transforms.
    segments : int
        Parts the signal was cut into; 1 unless it is longer than `nfft`.
    halfbandwidth_hz : float
        W: what lies within ± W of a frequency is averaged into its density.
    """

    frequencies: Floats
    density: Floats
    lower: Floats
    upper: Floats
    degrees_of_freedom: Floats
    time_halfbandwidth: float
    tapers: int
    nfft: int
    segments: int
    halfbandwidth_hz: float

    @property
    def resolution_hz(self) -> float:
        """Smallest distance (Hz) at which two lines are told apart: 2W."""
        return 2.0 * self.halfbandwidth_hz


@dataclass(frozen=True)
class SpectralPeak:
    """A local maximum of the density that noise alone does not explain.

    Attributes
    ----------
    frequency_hz : float
    density, lower, upper : float
        Density at the peak and its 95 % band (unit² / Hz).
    prominence_db : float
        Height above the higher of the two valleys that separate it from higher ground.
    """

    frequency_hz: float
    density: float
    prominence_db: float
    lower: float
    upper: float


@dataclass(frozen=True)
class FrequencyResponse:
    """Non-parametric frequency response from input to output.

    Attributes
    ----------
    frequencies : ndarray, shape (nfft // 2 + 1,)
        Hz.
    response : ndarray of complex, same shape
        The H1 estimate (output unit / input unit).
    gain, gain_lower, gain_upper : ndarray, same shape
        Its modulus and 95 % band.
    phase_deg : ndarray, same shape
        Its phase in (-180, 180].
    coherence : ndarray, same shape
        Squared coherence, 0 to 1.
    degrees_of_freedom : ndarray, same shape
        Twice the number of independent eigencoefficients behind each value.
    """

    frequencies: Floats
    response: NDArray[np.complex128]
    gain: Floats
    gain_lower: Floats
    gain_upper: Floats
    phase_deg: Floats
    coherence: Floats
    degrees_of_freedom: Floats


def multitaper_spectrum(
    signal: Floats,
    sampling_rate: float,
    time_halfbandwidth: float = 4.0,
    nfft: int = 8192,
) -> Spectrum:
    """Thomson's adaptive multitaper estimate of the power spectral density.

    The mean is removed. A signal of up to `nfft` samples is padded with zeros to `nfft`. A
    longer one is cut into the fewest equal segments of at most `nfft` samples, whose
    eigenspectra are averaged: `nfft` then sets the resolution, every segment narrows the
    band, and the memory needed does not grow with the signal. Of such a signal at most one
    sample a segment is left over at its end.

    The adaptive weights are those of Percival & Walden (1993, eq. 368a), the chi-square band
    has the degrees of freedom of their eq. 370b, halved at zero and at the Nyquist frequency.
    It tells the chance of the record, not what averaging over ± W does to a narrower peak.
    The whole density is scaled (by a few per cent at most for a stationary signal) so that
    its integral equals the variance.

    Parameters
    ----------
    signal : ndarray, shape (N,)
    sampling_rate : float
        Hz.
    time_halfbandwidth : float
        NW, at least 1; K = 2NW - 1 tapers are used.
    nfft : int
        Length of the transforms, more than 2NW.

    Returns
    -------
    Spectrum

    Raises
    ------
    InputError
        When the settings do not fit each other or the signal, or the signal is constant.
    """
    layout = _Layout.of(signal.size, sampling_rate, time_halfbandwidth, nfft)
    centred = signal - signal.mean()
    variance = float(np.mean(centred**2))
    if variance == 0.0:
        raise InputError("spectrum", "the signal is constant", "choose a channel that varies")
    eigenspectra = np.zeros((layout.tapers, layout.frequencies.size))
    for coefficients in _eigencoefficients(centred, layout):
        eigenspectra += np.abs(coefficients) ** 2
    eigenspectra /= layout.segments * sampling_rate

    weights = _adaptive_weights(eigenspectra, layout, variance / sampling_rate)
    density = _one_sided(_average(weights, eigenspectra), nfft)
    density *= variance / (density.sum() * sampling_rate / nfft)
    freedom = layout.freedom(weights)
    lower, upper = _chi_square_band(density, freedom)
    return Spectrum(
        frequencies=layout.frequencies,
        density=density,
        lower=lower,
        upper=upper,
        degrees_of_freedom=freedom,
        time_halfbandwidth=float(time_halfbandwidth),
        tapers=layout.tapers,
        nfft=nfft,
        segments=layout.segments,
        halfbandwidth_hz=layout.halfbandwidth_hz,
    )


def spectral_peaks(spectrum: Spectrum) -> list[SpectralPeak]:
    """Peaks of a density that stand out from what noise makes by chance.

    A peak is a local maximum whose prominence exceeds the spread between the largest and
    the smallest of M independent estimates, reached in 5 % of records:
    ``10 log10(q(1 - a) / q(a))`` with q the quantile of the estimate over its expectation
    (chi-square, the degrees of freedom those found at the peak and in its valley), ``a =
    0.05 / (2M)``, and M the number of resolution cells (width 2W) up to the Nyquist
    frequency. The rule is applied to the density as it is and to its averages over 4 and
    over 16 cells, whose smaller spread lets broad, well damped peaks show; a broad one
    counts only where no narrower one stands on its upper half (in dB). Within W of
    zero and of the Nyquist frequency the density is held at its value W away, because
    removing the mean digs a valley there.

    Parameters
    ----------
    spectrum : Spectrum

    Returns
    -------
    list of SpectralPeak
        By rising frequency.
    """
    from scipy.ndimage import uniform_filter1d

    step = spectrum.frequencies[1]
    level = _without_ends(spectrum)
    found: dict[int, float] = {}
    for cells in PEAK_WIDTHS:
        width = max(1, round(cells * spectrum.resolution_hz / step))
        if cells > 1 and width > PEAK_SHARE * level.size:
            break
        averaged = level if cells == 1 else uniform_filter1d(level, width, mode="nearest")
        narrower = np.array(list(found), dtype=np.int64)
        for hill in _prominent(averaged, spectrum, cells):
            known = (narrower >= hill.start - width) & (narrower <= hill.stop + width)
            if cells == 1 or not known.any():
                found[hill.top] = hill.prominence_db
    return [
        SpectralPeak(
            frequency_hz=float(spectrum.frequencies[index]),
            density=float(spectrum.density[index]),
            prominence_db=float(found[index]),
            lower=float(spectrum.lower[index]),
            upper=float(spectrum.upper[index]),
        )
        for index in sorted(found)
    ]


def line_spacing(frequencies: Sequence[float]) -> float | None:
    """Spacing in Hz of evenly spaced spectral lines, as a periodic input makes; else None.

    Lines are more than ten peaks of which four fifths follow each other at a distance within 30 %
    of the median one.
    """
    gaps = np.diff(np.sort(np.asarray(frequencies, dtype=float)))
    if gaps.size < FEWEST_LINES:
        return None
    spacing = float(np.median(gaps))
    even = np.abs(gaps - spacing) <= 0.3 * spacing
    return spacing if float(np.mean(even)) >= 0.8 else None


def resonance_count(peaks: Sequence[SpectralPeak]) -> int:
    """How many peaks may be resonances: none where they are the lines of a periodic input."""
    return 0 if line_spacing([peak.frequency_hz for peak in peaks]) else len(peaks)


FEWEST_LINES = 10
"""So many evenly spaced peaks are lines of the input and not modes."""
PEAK_WIDTHS = (1, 4, 16)
"""Resolution cells over which the density is averaged before peaks are sought."""
PEAK_SHARE = 0.2
"""No average is taken over more than this share of the frequency axis."""


def multitaper_frequency_response(
    input: Floats,  # noqa: A002
    output: Floats,
    sampling_rate: float,
    time_halfbandwidth: float = 4.0,
    nfft: int = 8192,
) -> FrequencyResponse:
    """Frequency response and coherence from the multitaper cross-spectrum.

    H1 = S_uy / S_uu: unbiased by noise on the output, pulled towards zero by noise on the
    input. Input, output and cross-spectrum share one set of weights, the geometric mean of
    the two signals' adaptive weights, so the coherence never exceeds 1. The band of the
    gain is Student's: ``|H| (1 ± t sqrt((1 - γ²) / (γ² (ν - 2))))`` with ν - 2 degrees of
    freedom (Bendat & Piersol 2010, section 9.2, for the modulus alone), cut off at 0.
    Signals longer than `nfft` are cut into segments as in `multitaper_spectrum`.

    Parameters
    ----------
    input, output : ndarray, shape (N,)
    sampling_rate : float
        Hz.
    time_halfbandwidth : float
        NW, at least 1.5 (two tapers): with a single estimate every coherence is 1.
    nfft : int
        Length of the transforms, more than 2NW.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    InputError
        When the settings do not fit each other or the signals, or a signal is constant.
    """
    from scipy.stats import t as student

    if input.size != output.size:
        raise InputError(
            "spectrum",
            f"the input has {input.size} samples and the output {output.size}",
            "give two signals of equal length",
        )
    layout = _Layout.of(input.size, sampling_rate, time_halfbandwidth, nfft)
    if layout.tapers * layout.segments < 2:
        raise InputError(
            "spectrum: time_halfbandwidth",
            f"{time_halfbandwidth:g} gives a single taper, and a coherence needs two",
            "choose at least 1.5",
        )
    signals = [signal - signal.mean() for signal in (input, output)]
    variances = [float(np.mean(signal**2)) for signal in signals]
    if min(variances) == 0.0:
        raise InputError("spectrum", "a signal is constant", "choose channels that vary")
    shape = (layout.tapers, layout.frequencies.size)
    own = [np.zeros(shape), np.zeros(shape)]
    cross = np.zeros(shape, dtype=np.complex128)
    for first, second in zip(*(_eigencoefficients(one, layout) for one in signals), strict=True):
        own[0] += np.abs(first) ** 2
        own[1] += np.abs(second) ** 2
        cross += np.conj(first) * second
    scale = layout.segments * sampling_rate
    weights = np.sqrt(
        np.prod(
            [
                _adaptive_weights(spectra / scale, layout, variance / sampling_rate)
                for spectra, variance in zip(own, variances, strict=True)
            ],
            axis=0,
        )
    )
    s_uu, s_yy = (_average(weights, spectra) for spectra in own)
    s_uy = _average(weights, cross)
    response = s_uy / s_uu
    gain = np.abs(response)
    coherence = np.minimum(np.abs(s_uy) ** 2 / (s_uu * s_yy), 1.0)
    freedom = layout.freedom(weights)
    # At zero and Nyquist the coefficients are real and the count is halved; keep one free.
    residual_freedom = np.maximum(freedom - 2.0, 1.0)
    quantile = student.ppf(0.5 + CONFIDENCE / 2.0, residual_freedom)
    # γ² = 0 means nothing is known: an infinite band, said without a division by zero.
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = quantile * np.sqrt(s_yy / s_uu * (1.0 - coherence) / residual_freedom)
    return FrequencyResponse(
        frequencies=layout.frequencies,
        response=response,
        gain=gain,
        gain_lower=np.maximum(gain - radius, 0.0),
        gain_upper=gain + radius,
        phase_deg=np.degrees(np.angle(response)),
        coherence=coherence,
        degrees_of_freedom=freedom,
    )


@dataclass(frozen=True)
class _Layout:
    """How a signal is cut, tapered and transformed."""

    sequences: Floats  # (K, L): the tapers, each of unit energy
    concentrations: Floats  # (K,): share of a taper's energy within its band
    segments: int
    nfft: int
    frequencies: Floats
    halfbandwidth_hz: float

    @property
    def tapers(self) -> int:
        return int(self.concentrations.size)

    @classmethod
    def of(
        cls, samples: int, sampling_rate: float, time_halfbandwidth: float, nfft: int
    ) -> _Layout:
        from scipy.signal.windows import dpss

        tapers = int(2 * time_halfbandwidth - 1)
        if tapers < 1:
            raise InputError(
                "spectrum: time_halfbandwidth",
                f"{time_halfbandwidth:g} leaves no taper",
                "choose at least 1; 4 is usual",
            )
        segments = -(-samples // nfft)
        length = samples // max(segments, 1)
        if length <= 2 * time_halfbandwidth:
            raise InputError(
                "spectrum",
                f"segments of {length} samples are too short for a time-halfbandwidth of"
                f" {time_halfbandwidth:g}",
                "choose a larger nfft or a smaller time_halfbandwidth, or give more samples",
            )
        sequences, concentrations = dpss(
            length, time_halfbandwidth, Kmax=tapers, return_ratios=True
        )
        return cls(
            sequences=sequences,
            # Rounding may leave a share of 1 or more; something always leaks.
            concentrations=np.minimum(concentrations, 1.0 - np.finfo(np.float64).eps),
            segments=segments,
            nfft=nfft,
            frequencies=np.asarray(np.fft.rfftfreq(nfft, 1.0 / sampling_rate), np.float64),
            halfbandwidth_hz=time_halfbandwidth * sampling_rate / length,
        )

    def freedom(self, weights: Floats) -> Floats:
        """Degrees of freedom of a weighted average, Percival & Walden (1993, eq. 370b)."""
        freedom = 2.0 * self.segments * weights.sum(axis=0) ** 2 / (weights**2).sum(axis=0)
        # Real coefficients have half the freedom of complex ones.
        freedom[0] /= 2.0
        if self.nfft % 2 == 0:
            freedom[-1] /= 2.0
        return freedom


def _eigencoefficients(signal: Floats, layout: _Layout) -> Iterator[NDArray[np.complex128]]:
    """Transforms of the tapered segments, one (K, nfft // 2 + 1) array a segment."""
    length = layout.sequences.shape[1]
    for segment in signal[: layout.segments * length].reshape(layout.segments, length):
        yield np.fft.rfft(layout.sequences * segment, layout.nfft, axis=1)


def _adaptive_weights(eigenspectra: Floats, layout: _Layout, flat_density: float) -> Floats:
    """Thomson's weights b_k² λ_k, shape (K, F), Percival & Walden (1993, eq. 368a).

    A taper counts less wherever its leakage from the rest of the spectrum, at most
    (1 - λ_k) times the variance, outweighs the density itself. The factor S², common to the
    tapers of one frequency, is left out: it cancels in every use, and would make the weights
    vanish where there is no power at all.
    """
    kept = layout.concentrations[:, np.newaxis]
    leaked = (1.0 - kept) * flat_density
    if layout.tapers == 1:
        return np.ones_like(eigenspectra)
    density = eigenspectra[:2].mean(axis=0)
    for _ in range(MOST_WEIGHT_ITERATIONS):
        weights = kept / (kept * density + leaked) ** 2
        previous, density = density, _average(weights, eigenspectra)
        if np.all(np.abs(density - previous) <= 1e-9 * density):
            break
    return weights


MOST_WEIGHT_ITERATIONS = 500
"""The fixed point is reached in some ten steps nearly everywhere; this bounds the rest."""


def _average(weights: Floats, values: NDArray) -> NDArray:
    return (weights * values).sum(axis=0) / weights.sum(axis=0)


def _one_sided(density: Floats, nfft: int) -> Floats:
    """Fold the negative frequencies onto the positive ones."""
    folded = 2.0 * density
    folded[0] = density[0]
    if nfft % 2 == 0:
        folded[-1] = density[-1]
    return folded


def _chi_square_band(density: Floats, freedom: Floats) -> tuple[Floats, Floats]:
    from scipy.stats import chi2

    tail = (1.0 - CONFIDENCE) / 2.0
    return (
        density * freedom / chi2.ppf(1.0 - tail, freedom),
        density * freedom / chi2.ppf(tail, freedom),
    )


def _without_ends(spectrum: Spectrum) -> Floats:
    """The density held constant within W of zero and of the Nyquist frequency."""
    density = spectrum.density.copy()
    inner = np.flatnonzero(
        (spectrum.frequencies >= spectrum.halfbandwidth_hz)
        & (spectrum.frequencies <= spectrum.frequencies[-1] - spectrum.halfbandwidth_hz)
    )
    if inner.size:
        density[: inner[0]] = density[inner[0]]
        density[inner[-1] + 1 :] = density[inner[-1]]
    return density


class _Hill(NamedTuple):
    """A prominent local maximum: its index, and where it is halfway down (in dB)."""

    top: int
    start: float
    stop: float
    prominence_db: float


def _prominent(averaged: Floats, spectrum: Spectrum, cells: int) -> list[_Hill]:
    """Local maxima whose prominence exceeds the noise's spread."""
    from scipy.signal import find_peaks
    from scipy.stats import chi2

    decibels = 10.0 * np.log10(np.maximum(averaged, np.finfo(np.float64).tiny))
    tops, found = find_peaks(decibels, prominence=0.0, width=0.0, rel_height=0.5)
    left, right = found["left_bases"], found["right_bases"]
    valleys = np.where(averaged[left] > averaged[right], left, right)
    independent = max(1.0, spectrum.frequencies[-1] / (cells * spectrum.resolution_hz))
    tail = (1.0 - CONFIDENCE) / (2.0 * independent)
    freedom = cells * spectrum.degrees_of_freedom
    high = chi2.isf(tail, freedom[tops]) / freedom[tops]
    low = chi2.ppf(tail, freedom[valleys]) / freedom[valleys]
    return [
        _Hill(int(tops[k]), found["left_ips"][k], found["right_ips"][k], found["prominences"][k])
        for k in np.flatnonzero(found["prominences"] > 10.0 * np.log10(high / low))
    ]
