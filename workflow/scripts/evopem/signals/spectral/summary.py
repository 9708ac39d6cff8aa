"""Settings and peaks of a multitaper spectrum, as they are kept beside its values."""

from __future__ import annotations

from dataclasses import dataclass

from evopem.signals.spectral.multitaper import (
    SpectralPeak,
    Spectrum,
    resonance_count,
    spectral_peaks,
)


@dataclass(frozen=True)
class SpectrumSummary:
    """What the order search and the report need of a spectrum.

    Attributes
    ----------
    time_halfbandwidth : float
    tapers, nfft, segments : int
    resolution_hz : float
    peaks : tuple of SpectralPeak
    resonances : int
        Peaks that may be resonances; 0 where they are the lines of a periodic input.
    """

    time_halfbandwidth: float
    tapers: int
    nfft: int
    segments: int
    resolution_hz: float
    peaks: tuple[SpectralPeak, ...]
    resonances: int


def summarize_spectrum(spectrum: Spectrum) -> SpectrumSummary:
    """Find the peaks of a spectrum and count those that may be resonances."""
    peaks = tuple(spectral_peaks(spectrum))
    return SpectrumSummary(
        time_halfbandwidth=spectrum.time_halfbandwidth,
        tapers=spectrum.tapers,
        nfft=spectrum.nfft,
        segments=spectrum.segments,
        resolution_hz=spectrum.resolution_hz,
        peaks=peaks,
        resonances=resonance_count(peaks),
    )
