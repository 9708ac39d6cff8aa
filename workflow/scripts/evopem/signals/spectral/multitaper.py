"""Thomson's multitaper estimate of the power spectral density, with its 95 % band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.spectral.tapers import (
    Tapering,
    adaptive_weights,
    chi_square_band,
    eigencoefficients,
    one_sided,
    weighted_average,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Spectrum:
    """One-sided power spectral density with its 95 % confidence band."""

    frequencies: Floats  # Hz, from 0 to the Nyquist frequency
    # unit² / Hz; the density's sum times the frequency step is the signal's variance
    density: Floats
    lower: Floats  # unit² / Hz; the density's sum times the frequency step is the signal's variance
    upper: Floats
    degrees_of_freedom: Floats  # of the chi-square distribution behind the band
    time_halfbandwidth: float  # NW
    tapers: int  # K = 2NW - 1
    nfft: int  # length of the transforms
    segments: int  # segments of the signal; 1 unless it is longer than `nfft`
    halfbandwidth_hz: float  # W: the density at a frequency is an average over ± W

    @property
    def resolution_hz(self) -> float:
        """Smallest distance (Hz) at which two lines are resolved: 2W."""
        return 2.0 * self.halfbandwidth_hz


def multitaper_spectrum(
    signal: Floats,
    sampling_rate: float,
    time_halfbandwidth: float = 4.0,
    nfft: int = 8192,
) -> Spectrum:
    """Thomson's adaptive multitaper estimate of the power spectral density.

    The mean is removed. A signal of up to `nfft` samples is padded with zeros to `nfft`. A
    longer one is divided into the fewest equal segments of at most `nfft` samples, whose
    eigenspectra are averaged. Then `nfft` sets the resolution, every segment narrows the
    band, and the memory does not grow with the signal. At most one sample a segment is left
    out at the end.

    The adaptive weights are those of Percival & Walden (1993, eq. 368a), the chi-square band
    has the degrees of freedom of their eq. 370b, halved at zero and at the Nyquist frequency.
    It covers the variance of the estimate, not the bias of a peak narrower than W.
    The whole density is scaled (by a few per cent at most for a stationary signal) so that
    its integral equals the variance.

    `time_halfbandwidth` is NW, at least 1, and K = 2NW - 1 tapers are used; the length `nfft` of
    the transforms is more than 2NW.
    """
    layout = Tapering.of(signal.size, sampling_rate, time_halfbandwidth, nfft)
    centred = signal - signal.mean()
    variance = float(np.mean(centred**2))
    if variance == 0.0:
        raise InputError("spectrum", "the signal is constant", "choose a channel that varies")
    eigenspectra = np.zeros((layout.tapers, layout.frequencies.size))
    for coefficients in eigencoefficients(centred, layout):
        eigenspectra += np.abs(coefficients) ** 2
    eigenspectra /= layout.segments * sampling_rate

    weights = adaptive_weights(eigenspectra, layout, variance / sampling_rate)
    density = one_sided(weighted_average(weights, eigenspectra), nfft)
    density *= variance / (density.sum() * sampling_rate / nfft)
    freedom = layout.freedom(weights)
    lower, upper = chi_square_band(density, freedom)
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
