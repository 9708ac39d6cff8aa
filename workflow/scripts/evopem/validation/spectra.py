"""Spectra of both parts of a recording: what inputs excite, and the output's peaks."""

import math
from dataclasses import dataclass

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import ArrayLike

from evopem.arrays import Array, Flags, Integers
from evopem.config.settings import SpectrumSettings
from evopem.config.structures import REGULARISED
from evopem.errors import InputError
from evopem.models.orders import Orders
from evopem.models.state_space import StateSpaceModel
from evopem.signals.faulty_samples import runs_of
from evopem.signals.peaks import spectral_peaks
from evopem.signals.recording import Recording
from evopem.signals.spectra import Spectrum, multitaper_spectrum

# An eigenvalue of the input's covariance this far below the largest counts as not excited:
# there the input is 40 dB weaker than where it is strongest.
EXCITED = 1e-4
# Where the relative power density of one part is this many times that of the other, the other has
# none: 20 dB.  By chance, with 14 degrees of freedom each, one frequency in 10^9 shows that.
NO_POWER = 100.0
# Share of the validation input's power outside the estimation input's bands from which on the
# validation is not comparable.
LARGEST_SHARE = 0.05
# Past samples by which inputs are distinguished, frequencies at which they are, and how many times
# other inputs enlarge the variance of a response that they hide; 2 by chance.
PAST, PLACES, HIDDEN = 20, 200, 100.0
TIME_HALFBANDWIDTH = 4.0
# Shortest part whose spectrum is estimated, and longest segment.
FEWEST_SAMPLES = 64
LONGEST_SEGMENT = 8192


def excitation_order(inputs: ArrayLike, largest: int) -> int:
    """Number of directions of the past of an input, (N,), that it excites, out of ``largest``.

    Eigenvalues of its covariance above 10⁻⁴ of the biggest: persistent excitation of that order in
    practice (Ljung 1999, chapter 13).
    """
    u = np.asarray(inputs, dtype=float)
    if u.size < largest or largest < 1 or np.ptp(u) == 0:
        return 0
    u = u - u.mean()
    # Whole windows only: zeros before the record would look like excitation.
    past = np.lib.stride_tricks.sliding_window_view(u, largest)
    eigenvalues = np.linalg.eigvalsh(past.T @ past)
    return int(np.count_nonzero(eigenvalues > EXCITED * eigenvalues[-1]))


def hidden_bands(inputs: Array, sampling_rate: float) -> list[tuple[tuple[float, float], ...]]:
    """Bands in Hz in which the response to each input, (N, m), is hidden by those to the others.

    The power of a wave in the past of an input that its covariance leaves (Capon 1969), alone and
    beside the past of the others, above a floor 40 dB below the power of each input.
    """
    if inputs.shape[1] < 2:
        return [()] * inputs.shape[1]
    u = (inputs - inputs.mean(axis=0)) / np.maximum(inputs.std(axis=0), np.finfo(float).tiny)
    lags = min(PAST, len(u))
    past = np.hstack([np.lib.stride_tricks.sliding_window_view(column, lags) for column in u.T])
    covariance = past.T @ past / len(past) + EXCITED * np.eye(past.shape[1])
    frequencies = 0.5 * sampling_rate * np.arange(1, PLACES + 1) / PLACES
    waves = np.exp(2j * np.pi * np.outer(np.arange(lags), frequencies / sampling_rate))
    inverse, bands = np.linalg.inv(covariance), []
    for first in range(0, len(covariance), lags):
        part = slice(first, first + lags)
        both = np.stack([np.linalg.inv(covariance[part, part]), inverse[part, part]])
        alone, beside = np.einsum("lf,ilk,kf->if", waves.conj(), both, waves).real
        bands.append(_bands(frequencies, beside > HIDDEN * alone, np.ones(PLACES)))
    return bands


@dataclass(frozen=True)
class SplitSpectra:
    """How far the validation input has power where the estimation input has none."""

    # Share of the validation input's power in bands without power in the estimation input, 0 to 1;
    # NaN where a part is too short or constant
    share_outside: float
    # The bands of ``share_outside``, with at least a hundredth of the power each
    bands_hz: tuple[tuple[float, float], ...]
    # Whether ``share_outside`` is at most :data:`LARGEST_SHARE`; None where it is not known
    comparable: bool | None


def needed_excitation(orders: Orders) -> list[int]:
    """The order of excitation that the plant of each input asks for.

    The coefficients of a regularised response have a prior beside what the input excites: 0.
    """
    if orders.structure in REGULARISED:
        return [0] * orders.inputs
    return [orders.na + nf + nb for nf, nb in zip(orders.nf, orders.nb, strict=True)]


def split_spectra(
    estimation: ArrayLike, validation: ArrayLike, sampling_rate: float
) -> SplitSpectra:
    """Compare the input's multitaper spectra in the estimation and the validation part.

    Averages over segments as long as the shorter part, scaled to unit power.
    """
    parts = [np.asarray(part, dtype=float) for part in (estimation, validation)]
    length = min(LONGEST_SEGMENT, *(part.size for part in parts))
    if length < FEWEST_SAMPLES or any(not np.ptp(part) > 0.0 for part in parts):
        return SplitSpectra(math.nan, (), None)
    first, second = (_relative_density(part, length) for part in parts)
    frequencies = np.asarray(np.fft.rfftfreq(length, 1.0 / sampling_rate), np.float64)
    outside = second > NO_POWER * first
    share = float(second[outside].sum())
    return SplitSpectra(share, _bands(frequencies, outside, second), share <= LARGEST_SHARE)


def _relative_density(signal: Array, length: int) -> Array:
    """Mean multitaper density of segments of one length, which may overlap, scaled to sum 1."""
    count = -(-signal.size // length)
    starts = np.linspace(0, signal.size - length, count).round().astype(int)
    density = np.zeros(length // 2 + 1)
    for start in starts:
        segment = signal[start : start + length]
        if np.ptp(segment) > 0.0:
            density += multitaper_spectrum(segment, 1.0, TIME_HALFBANDWIDTH, length).density
    return density / density.sum()


def _bands(frequencies: Array, inside: Flags, power: Array) -> tuple[tuple[float, float], ...]:
    """Ranges of neighbouring frequencies with at least a hundredth of the power."""
    return tuple(
        (float(frequencies[begin]), float(frequencies[end - 1]))
        for begin, end in runs_of(inside)
        if power[begin:end].sum() >= 0.01
    )


CHANCE_LEVEL = 0.01  # share of records in which a peak of a right model exceeds its `chance`
NOISE_GRID = 33  # frequencies within ±W at which the noise model's density is averaged


@dataclass(frozen=True)
class PeakEvidence:
    """The density of the output at a peak of its spectrum, compared with the model's."""

    frequency_hz: float
    # Density of the output over that of the model's response to the measured input and of its
    # noise; NaN where the model gives no finite density
    excess: float
    chance: float  # excess that chance reaches in 1 % of records, at whichever frequency


def peak_evidence(
    model: StateSpaceModel,
    samples: Recording,
    output: int,
    settings: SpectrumSettings | None = None,
) -> tuple[PeakEvidence, ...]:
    """Compare the peaks of an output's spectrum with the spectrum that the model gives it.

    That is the multitaper estimate of the simulated output plus ``2 H Λ H* / fs`` averaged over ±
    W. Where the model is right and the noise prevails, the ratio is a chi-square variable over its
    degrees of freedom (Percival & Walden 1993, section 7.4).  The limit counts every resolution
    cell of all outputs (Bonferroni).  By rising frequency; empty where there is no spectrum.
    """
    settings = settings or SpectrumSettings()
    shape = (samples.sampling_rate, settings.time_halfbandwidth, settings.nfft)
    try:
        spectrum = multitaper_spectrum(samples.outputs[:, output], *shape)
    except InputError:
        return ()
    peaks = spectral_peaks(spectrum)
    if not peaks:
        return ()
    index = np.searchsorted(spectrum.frequencies, [peak.frequency_hz for peak in peaks])
    modelled = _response_density(model, samples, output, spectrum)[index]
    modelled = modelled + _noise_density(model, output, spectrum, index)
    cells = max(1.0, spectrum.frequencies[-1] / spectrum.resolution_hz)
    freedom = spectrum.degrees_of_freedom[index]
    limits = scipy.stats.chi2.isf(CHANCE_LEVEL / (cells * model.outputs), freedom) / freedom
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = spectrum.density[index] / modelled
    excess[~np.isfinite(modelled)] = math.nan
    return tuple(
        PeakEvidence(peak.frequency_hz, float(ratio), float(limit))
        for peak, ratio, limit in zip(peaks, excess, limits, strict=True)
    )


def _response_density(
    model: StateSpaceModel, samples: Recording, output: int, spectrum: Spectrum
) -> Array:
    """Density of a simulated output; NaN where the simulation grows out of all numbers."""
    if not model.inputs:
        return np.zeros_like(spectrum.density)
    with np.errstate(all="ignore"):
        simulated = model.simulate(samples.inputs)[:, output]
    if not np.isfinite(simulated).all():
        return np.full_like(spectrum.density, math.nan)
    try:
        return multitaper_spectrum(
            simulated, samples.sampling_rate, spectrum.time_halfbandwidth, spectrum.nfft
        ).density
    except InputError:
        # A response that is constant.
        return np.zeros_like(spectrum.density)


def _noise_density(
    model: StateSpaceModel, output: int, spectrum: Spectrum, index: Integers
) -> Array:
    """One-sided density of the model's noise at some frequencies, averaged over ± W."""
    half = spectrum.halfbandwidth_hz * np.linspace(-1.0, 1.0, NOISE_GRID)
    nyquist = spectrum.frequencies[-1]
    around = np.clip(spectrum.frequencies[index][:, None] + half, 0.0, nyquist)
    rows = model.noise_response(around.ravel())[:, output, :]
    power = np.einsum("fi,ij,fj->f", rows, model.noise_covariance, rows.conj()).real
    return np.asarray(power.reshape(around.shape).mean(axis=1) / nyquist, np.float64)
