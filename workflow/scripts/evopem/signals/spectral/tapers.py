"""Slepian tapers, eigencoefficients and their adaptive weights.

Sources: Thomson, D. J. (1982), "Spectrum estimation and harmonic analysis", Proc. IEEE 70;
Percival & Walden (1993), "Spectral Analysis for Physical Applications", chapter 7.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError

Floats = NDArray[np.float64]

CONFIDENCE = 0.95

# Bound on the iterations of the adaptive weights, which nearly always converge in about ten.
MAX_WEIGHT_ITERATIONS = 500


@dataclass(frozen=True)
class Tapering:
    """Segments, tapers and transforms of a signal."""

    sequences: Floats  # (K, L): the tapers, each of unit energy
    concentrations: Floats  # (K,): share of a taper's energy within its band
    segments: int
    nfft: int
    frequencies: Floats
    halfbandwidth_hz: float

    @property
    def tapers(self) -> int:
        """Number of tapers K."""
        return int(self.concentrations.size)

    @classmethod
    def of(
        cls, samples: int, sampling_rate: float, time_halfbandwidth: float, nfft: int
    ) -> Tapering:
        """Tapers of 2NW - 1 sequences for a signal, and the segments it is divided into."""
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
            # Rounding may give a share of 1 or more, but some leakage always remains.
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


def eigencoefficients(signal: Floats, layout: Tapering) -> Iterator[NDArray[np.complex128]]:
    """Transforms of the tapered segments, one (K, nfft // 2 + 1) array a segment."""
    length = layout.sequences.shape[1]
    for segment in signal[: layout.segments * length].reshape(layout.segments, length):
        yield np.fft.rfft(layout.sequences * segment, layout.nfft, axis=1)


def adaptive_weights(eigenspectra: Floats, layout: Tapering, flat_density: float) -> Floats:
    """Thomson's weights b_k² λ_k, shape (K, F), Percival & Walden (1993, eq. 368a).

    A taper counts less wherever its leakage from the rest of the spectrum, at most
    (1 - λ_k) times the variance, outweighs the density itself. The factor S², common to the
    tapers of one frequency, is left out: it cancels in every use, and would make the weights
    vanish where there is no power at all.
    """
    if layout.tapers == 1:
        return np.ones_like(eigenspectra)
    # In units of about the flat density: a square of the density itself may leave the range of
    # numbers. A power of two changes no other bit.
    _, exponent = np.frexp(flat_density)
    eigenspectra, flat_density = (
        np.ldexp(eigenspectra, -exponent),
        np.ldexp(flat_density, -exponent),
    )
    kept = layout.concentrations[:, np.newaxis]
    leaked = (1.0 - kept) * flat_density
    density = eigenspectra[:2].mean(axis=0)
    for _ in range(MAX_WEIGHT_ITERATIONS):
        weights = kept / (kept * density + leaked) ** 2
        previous, density = density, weighted_average(weights, eigenspectra)
        if np.all(np.abs(density - previous) <= 1e-9 * density):
            break
    return weights


def weighted_average(weights: Floats, values: NDArray) -> NDArray:
    return (weights * values).sum(axis=0) / weights.sum(axis=0)


def one_sided(density: Floats, nfft: int) -> Floats:
    """Add the density at negative frequencies to that at positive ones."""
    folded = 2.0 * density
    folded[0] = density[0]
    if nfft % 2 == 0:
        folded[-1] = density[-1]
    return folded


def chi_square_band(density: Floats, freedom: Floats) -> tuple[Floats, Floats]:
    from scipy.stats import chi2

    tail = (1.0 - CONFIDENCE) / 2.0
    return (
        density * freedom / chi2.ppf(1.0 - tail, freedom),
        density * freedom / chi2.ppf(tail, freedom),
    )
