"""The output's spectrum at its peaks, against the spectrum that a model gives the output."""

import math
from dataclasses import dataclass

import numpy as np

from evopem.arrays import Array, Integers
from evopem.config.settings import SpectrumSettings
from evopem.errors import InputError
from evopem.models.state_space import StateSpaceModel
from evopem.signals.peaks import spectral_peaks
from evopem.signals.recording import Recording
from evopem.signals.spectra import Spectrum, multitaper_spectrum

# Share of records in which a peak of a right model exceeds its `chance`.
CHANCE_LEVEL = 0.01
# Frequencies within ±W at which the noise model's density is averaged.
NOISE_GRID = 33


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
    cell (Bonferroni).  By rising frequency; empty where no spectrum can be estimated.
    """
    from scipy.stats import chi2

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
    limits = chi2.isf(CHANCE_LEVEL / cells, freedom) / freedom
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
    density = power.reshape(around.shape).mean(axis=1) / nyquist
    return np.asarray(density, np.float64)
