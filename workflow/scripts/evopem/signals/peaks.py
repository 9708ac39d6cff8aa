"""Peaks of a spectral density, and the lines of a periodic input among them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.signals.spectra import CONFIDENCE, Spectrum
from evopem.signals.spectrum_summary import SpectralPeak, SpectrumSummary

Floats = NDArray[np.float64]

# Evenly spaced peaks from this number on are lines of a periodic input.
MIN_LINES = 10
# Resolution cells over which the density is averaged before peaks are looked for.
PEAK_WIDTHS = (1, 4, 16)
# Largest share of the frequency axis that an average extends over.
MAX_AVERAGED_SHARE = 0.2


def spectral_peaks(spectrum: Spectrum) -> list[SpectralPeak]:
    """Peaks of a density that are larger than noise alone makes them, rising in frequency.

    A peak is a local maximum whose prominence exceeds the spread between the largest and the
    smallest of M independent estimates, reached in 5 % of records: ``10 log10(q(1 - a) / q(a))``
    with q the chi-square quantile over its expectation, ``a = 0.05 / (2M)``, and M the number of
    resolution cells (width 2W). So are those of averages over 4 and over 16 cells, which reveal
    broad peaks; a broad one counts only where no narrower one lies on its upper half.
    """
    from scipy.ndimage import uniform_filter1d

    step = spectrum.frequencies[1]
    level = _without_ends(spectrum)
    found: dict[int, _Peak] = {}
    for cells in PEAK_WIDTHS:
        width = max(1, round(cells * spectrum.resolution_hz / step))
        if cells > 1 and width > MAX_AVERAGED_SHARE * level.size:
            break
        averaged = level if cells == 1 else uniform_filter1d(level, width, mode="nearest")
        narrower = np.array(list(found), dtype=np.int64)
        for peak in _prominent(averaged, spectrum, cells):
            known = (narrower >= peak.start - width) & (narrower <= peak.stop + width)
            if cells == 1 or not known.any():
                found[peak.top] = peak
    return [
        SpectralPeak(
            frequency_hz=float(spectrum.frequencies[index]),
            density=float(spectrum.density[index]),
            prominence_db=float(found[index].prominence_db),
            lower=float(spectrum.lower[index]),
            upper=float(spectrum.upper[index]),
        )
        for index in sorted(found)
    ]


def line_spacing(frequencies: Sequence[float]) -> float | None:
    """Spacing (Hz) of the lines of a periodic input, more than ten, most of them evenly spaced."""
    gaps = np.diff(np.sort(np.asarray(frequencies, dtype=float)))
    if gaps.size < MIN_LINES:
        return None
    spacing = float(np.median(gaps))
    even = np.abs(gaps - spacing) <= 0.3 * spacing
    return spacing if float(np.mean(even)) >= 0.8 else None


def resonance_count(peaks: Sequence[SpectralPeak]) -> int:
    """Count the peaks that may be resonances: none where they are lines of a periodic input."""
    return 0 if line_spacing([peak.frequency_hz for peak in peaks]) else len(peaks)


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


class _Peak(NamedTuple):
    """A prominent local maximum: its index, where it is halfway down (in dB), and its heights."""

    top: int
    start: float
    stop: float
    prominence_db: float


def _prominent(averaged: Floats, spectrum: Spectrum, cells: int) -> list[_Peak]:
    """Local maxima whose prominence exceeds the noise's spread."""
    from scipy.signal import find_peaks
    from scipy.stats import chi2

    decibels = 10.0 * np.log10(np.maximum(averaged, np.finfo(np.float64).tiny))
    tops, found = find_peaks(decibels, prominence=0.0, width=0.0, rel_height=0.5)
    left, right = found["left_bases"], found["right_bases"]
    valleys = np.where(averaged[left] > averaged[right], left, right)
    independent = max(1.0, spectrum.frequencies[-1] / (cells * spectrum.resolution_hz))
    freedom = cells * spectrum.degrees_of_freedom
    tail = (1.0 - CONFIDENCE) / (2.0 * independent)
    high = chi2.isf(tail, freedom[tops]) / freedom[tops]
    low = chi2.ppf(tail, freedom[valleys]) / freedom[valleys]
    heights = found["prominences"]
    return [
        _Peak(int(tops[k]), found["left_ips"][k], found["right_ips"][k], heights[k])
        for k in np.flatnonzero(heights > 10.0 * np.log10(high / low))
    ]
