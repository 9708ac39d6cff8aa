"""Empirical frequency responses and coherence from multitaper spectra.

Sources: Bendat & Piersol (2010), "Random Data", section 7.4 and chapter 9; Carter (1987).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.recording import Recording
from evopem.signals.spectral.tapers import (
    CONFIDENCE,
    Tapering,
    adaptive_weights,
    eigencoefficients,
    weighted_average,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Empirical frequency responses from m inputs to l outputs, at F frequencies."""

    frequencies: Floats  # (F,), Hz
    response: NDArray[np.complex128]  # (F, l, m), the H1 estimate (output unit / input unit)
    gain_lower: Floats  # (F, l, m), 95 % band of its modulus
    gain_upper: Floats
    coherence: Floats  # (F, l), multiple squared coherence of an output with all inputs, 0 to 1
    degrees_of_freedom: Floats  # (F,), twice the number of independent estimates behind each value

    @property
    def gain(self) -> Floats:
        """Modulus of the response, (F, l, m)."""
        return np.abs(self.response)

    @property
    def phase_deg(self) -> Floats:
        """Phase of the response in (-180, 180], (F, l, m)."""
        return np.degrees(np.angle(self.response))

    def coherence_limit(self, probability: float) -> Floats:
        """What the coherence of independent signals exceeds with a probability, (F,).

        Of n independent estimates it has the beta distribution of m and n - m (Carter 1987).  NaN
        where there are no more than m estimates.
        """
        from scipy.stats import beta

        inputs, estimates = self.response.shape[2], self.degrees_of_freedom / 2.0
        limit = beta.isf(probability, inputs, np.maximum(estimates - inputs, np.finfo(float).tiny))
        return np.where(estimates > inputs, limit, np.nan)


def frequency_response(
    recording: Recording, time_halfbandwidth: float = 4.0, nfft: int = 8192
) -> FrequencyResponse:
    """Frequency responses and coherence of all channels from their multitaper cross-spectra.

    H1 = S_yu S_uu^-1: unbiased by noise on the outputs, pulled towards zero by noise on the
    inputs. All spectra share one set of weights, the geometric mean of the signals' adaptive
    weights, so the coherence never exceeds 1. The band of the gain is Student's, with ν - 2m
    degrees of freedom: ``|H_ij| ± t sqrt((S_uu^-1)_jj S_yy,i (1 - γ_i²) / (ν - 2m))`` (Bendat &
    Piersol 2010, section 9.2, for the modulus alone), cut off at 0. Segments longer than `nfft`
    samples are divided as in `multitaper_spectrum`; the estimates of all segments are averaged.

    `time_halfbandwidth` is NW; with a single estimate every coherence is 1, which is refused.
    """
    from scipy.stats import t as student

    inputs = recording.inputs.shape[1]
    spectra, layout, weights = _spectra(recording, time_halfbandwidth, nfft)
    s_uu, s_yu = spectra[:, :inputs, :inputs], spectra[:, inputs:, :inputs]
    s_yy = np.einsum("fii->fi", spectra)[:, inputs:].real
    inverse = np.linalg.pinv(s_uu, rcond=1e-10, hermitian=True)
    response = s_yu @ inverse
    explained = np.einsum("fij,fij->fi", response, s_yu.conj()).real
    coherence = np.clip(explained / s_yy, 0.0, 1.0)
    freedom = layout.freedom(weights)
    # At zero and Nyquist the coefficients are real and the count is halved; keep one free.
    residual_freedom = np.maximum(freedom - 2.0 * inputs, 1.0)
    quantile = student.ppf(0.5 + CONFIDENCE / 2.0, residual_freedom)
    left = s_yy * (1.0 - coherence) * (quantile**2 / residual_freedom)[:, None]
    radius = np.sqrt(left[:, :, None] * np.einsum("fii->fi", inverse).real[:, None, :])
    return FrequencyResponse(
        frequencies=layout.frequencies,
        response=response,
        gain_lower=np.maximum(np.abs(response) - radius, 0.0),
        gain_upper=np.abs(response) + radius,
        coherence=coherence,
        degrees_of_freedom=freedom,
    )


def _spectra(
    recording: Recording, time_halfbandwidth: float, nfft: int
) -> tuple[NDArray[np.complex128], Tapering, Floats]:
    """Spectral matrices of inputs and outputs, (F, m + l, m + l), their layout and weights."""
    rate = recording.sampling_rate
    parts = [each for each in recording.segments if each.samples > 2.0 * time_halfbandwidth]
    signals = [np.column_stack([each.inputs, each.outputs]) for each in parts or recording.segments]
    signals = [each - each.mean(axis=0) for each in signals]
    variances = np.concatenate(signals).var(axis=0)
    if not variances.all():
        raise InputError("spectrum", "a signal is constant", "choose channels that vary")
    layouts = [Tapering.of(len(each), rate, time_halfbandwidth, nfft) for each in signals]
    longest = max(layouts, key=lambda each: each.sequences.shape[1])
    layout = replace(longest, segments=sum(each.segments for each in layouts))
    if layout.tapers * layout.segments < 2:
        raise InputError(
            "spectrum: time_halfbandwidth",
            f"{time_halfbandwidth:g} gives a single taper, and a coherence needs two",
            "choose at least 1.5",
        )
    channels = len(variances)
    shape = (layout.tapers, layout.frequencies.size, channels, channels)
    products = np.zeros(shape, dtype=np.complex128)
    for each, own in zip(signals, layouts, strict=True):
        columns = [eigencoefficients(np.ascontiguousarray(column), own) for column in each.T]
        for coefficients in zip(*columns, strict=True):
            found = np.stack(coefficients, axis=-1)
            products += found[..., :, None] * found[..., None, :].conj()
    products /= layout.segments * rate
    of_channels = [
        adaptive_weights(products[:, :, k, k].real, layout, variances[k] / rate)
        for k in range(channels)
    ]
    weights = np.exp(np.mean(np.log(of_channels), axis=0))
    averaged = weighted_average(weights[..., None, None], products)
    return averaged, layout, weights
