"""Empirical frequency response and coherence from multitaper spectra.

Source of the confidence band: Bendat & Piersol (2010), "Random Data", chapter 9.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.spectral.tapers import (
    CONFIDENCE,
    Tapering,
    adaptive_weights,
    eigencoefficients,
    weighted_average,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FrequencyResponse:
    """Empirical frequency response from input to output."""

    frequencies: Floats  # Hz
    response: NDArray[np.complex128]  # the H1 estimate (output unit / input unit)
    gain: Floats  # its modulus and 95 % band
    gain_lower: Floats
    gain_upper: Floats
    phase_deg: Floats  # its phase in (-180, 180]
    coherence: Floats  # squared coherence, 0 to 1
    # twice the number of independent eigencoefficients behind each value
    degrees_of_freedom: Floats

    def coherence_limit(self, probability: float) -> Floats:
        """What the squared coherence of independent signals exceeds with a probability.

        Of n independent estimates it exceeds ``1 - p^(1/(n - 1))`` with probability p (Carter 1987;
        Thomson 1982).  NaN where there is no more than one estimate.
        """
        estimates = self.degrees_of_freedom / 2.0
        with np.errstate(divide="ignore"):
            limit = 1.0 - probability ** (1.0 / (estimates - 1.0))
        return np.where(estimates > 1.0, limit, np.nan)


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
    Signals longer than `nfft` are divided into segments as in `multitaper_spectrum`.

    `input`, `output`, (N,). `sampling_rate`: Hz. `time_halfbandwidth`: NW, at least 1.5 (two
    tapers): with a single estimate every coherence is 1. `nfft`: Length of the transforms, more
    than 2NW.
    """
    from scipy.stats import t as student

    layout = _layout(input, output, sampling_rate, time_halfbandwidth, nfft)
    s_uu, s_yy, s_uy, weights = _spectra(input, output, layout, sampling_rate)
    response = s_uy / s_uu
    gain = np.abs(response)
    coherence = np.minimum(np.abs(s_uy) ** 2 / (s_uu * s_yy), 1.0)
    freedom = layout.freedom(weights)
    # At zero and Nyquist the coefficients are real and the count is halved; keep one free.
    residual_freedom = np.maximum(freedom - 2.0, 1.0)
    quantile = student.ppf(0.5 + CONFIDENCE / 2.0, residual_freedom)
    # Without coherence the band is infinite.
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


def _layout(
    input: Floats,  # noqa: A002
    output: Floats,
    sampling_rate: float,
    time_halfbandwidth: float,
    nfft: int,
) -> Tapering:
    """Tapers and segments of two signals of one length, at least two estimates in all."""
    if input.size != output.size:
        raise InputError(
            "spectrum",
            f"the input has {input.size} samples and the output {output.size}",
            "give two signals of equal length",
        )
    layout = Tapering.of(input.size, sampling_rate, time_halfbandwidth, nfft)
    if layout.tapers * layout.segments < 2:
        raise InputError(
            "spectrum: time_halfbandwidth",
            f"{time_halfbandwidth:g} gives a single taper, and a coherence needs two",
            "choose at least 1.5",
        )
    return layout


def _spectra(
    input: Floats,  # noqa: A002
    output: Floats,
    layout: Tapering,
    sampling_rate: float,
) -> tuple[Floats, Floats, NDArray[np.complex128], Floats]:
    """Spectra of input and output, their cross-spectrum, and the weights that they share."""
    signals = [signal - signal.mean() for signal in (input, output)]
    variances = [float(np.mean(signal**2)) for signal in signals]
    if min(variances) == 0.0:
        raise InputError("spectrum", "a signal is constant", "choose channels that vary")
    shape = (layout.tapers, layout.frequencies.size)
    own = [np.zeros(shape), np.zeros(shape)]
    cross = np.zeros(shape, dtype=np.complex128)
    for first, second in zip(*(eigencoefficients(one, layout) for one in signals), strict=True):
        own[0] += np.abs(first) ** 2
        own[1] += np.abs(second) ** 2
        cross += np.conj(first) * second
    scale = layout.segments * sampling_rate
    weights = np.sqrt(
        np.prod(
            [
                adaptive_weights(spectra / scale, layout, variance / sampling_rate)
                for spectra, variance in zip(own, variances, strict=True)
            ],
            axis=0,
        )
    )
    s_uu, s_yy = (weighted_average(weights, spectra) for spectra in own)
    return s_uu, s_yy, weighted_average(weights, cross), weights
