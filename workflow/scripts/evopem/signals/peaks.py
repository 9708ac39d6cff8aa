"""Peaks of a spectral density, and the lines of a periodic input among them."""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.signals.spectra import CONFIDENCE, Spectrum
from evopem.signals.spectrum_summary import SpectralPeak, SpectrumSummary

MIN_LINES = 10  # evenly spaced peaks from this number on are lines of a periodic input
# Resolution cells over which the density is averaged before peaks are looked for.
PEAK_WIDTHS = (1, 4, 16)
MAX_AVERAGED_SHARE = 0.2  # largest share of the frequency axis that an average extends over


def spectral_peaks(spectrum: Spectrum) -> list[SpectralPeak]:
    """Peaks of a density that are larger than noise alone makes them, rising in frequency.

    A peak is a local maximum whose prominence exceeds the spread between the largest and the
    smallest of M independent estimates, reached in 5 % of recordings: ``10 log10(q(1 - a) / q(a))``
    with q the chi-square quantile over its expectation, ``a = 0.05 / (2M)``, and M the number of
    resolution cells (width 2W). So are those of averages over 4 and over 16 cells, which reveal
    broad peaks; a broad one counts only where no narrower one lies on its upper half.
    """
    step = spectrum.frequencies[1]
    level = _without_ends(spectrum)
    prominences: dict[int, float] = {}
    for cells in PEAK_WIDTHS:
        width = max(1, round(cells * spectrum.resolution_hz / step))
        if cells > 1 and width > MAX_AVERAGED_SHARE * level.size:
            break
        averaged = (
            level if cells == 1 else scipy.ndimage.uniform_filter1d(level, width, mode="nearest")
        )
        narrower = np.array(list(prominences), dtype=np.int64)
        for top, start, stop, prominence in _prominent(averaged, spectrum, cells):
            known = (narrower >= start - width) & (narrower <= stop + width)
            if cells == 1 or not known.any():
                prominences[top] = prominence
    tops = sorted(prominences)
    parts = spectrum.frequencies, spectrum.density, spectrum.lower, spectrum.upper
    rows = zip(tops, *(part[tops].tolist() for part in parts), strict=True)
    return [SpectralPeak(f, density, float(prominences[k]), *band) for k, f, density, *band in rows]


def line_spacing(frequencies: Sequence[float]) -> float | None:
    """Spacing (Hz) of the lines of a periodic input, more than ten, most of them evenly spaced."""
    gaps = np.diff(np.sort(np.asarray(frequencies, dtype=float)))
    if gaps.size < MIN_LINES:
        return None
    spacing = float(np.median(gaps))
    even = np.abs(gaps - spacing) <= 0.3 * spacing
    return spacing if float(np.mean(even)) >= 0.8 else None


def summarize_spectrum(spectrum: Spectrum) -> SpectrumSummary:
    """Find the peaks of a spectrum and count those that may be resonances."""
    peaks = tuple(spectral_peaks(spectrum))
    lines = line_spacing([peak.frequency_hz for peak in peaks])
    return SpectrumSummary(
        time_halfbandwidth=spectrum.time_halfbandwidth,
        tapers=spectrum.tapers,
        nfft=spectrum.nfft,
        segments=spectrum.segments,
        resolution_hz=spectrum.resolution_hz,
        peaks=peaks,
        resonances=0 if lines else len(peaks),
    )


def _without_ends(spectrum: Spectrum) -> Array:
    """The density held constant within W of zero and of the Nyquist frequency."""
    f, half = spectrum.frequencies, spectrum.halfbandwidth_hz
    inner = np.flatnonzero((f >= half) & (f <= f[-1] - half))
    if not inner.size:
        return spectrum.density
    return spectrum.density[np.clip(np.arange(f.size), inner[0], inner[-1])]


def _prominent(
    averaged: Array, spectrum: Spectrum, cells: int
) -> Iterator[tuple[int, float, float, float]]:
    """Local maxima whose prominence exceeds the noise's spread. Of each the index, where it is
    halfway down (in dB) on both sides, and the prominence in dB."""
    decibels = 10.0 * np.log10(np.maximum(averaged, np.finfo(np.float64).tiny))
    tops, properties = scipy.signal.find_peaks(decibels, prominence=0.0, width=0.0, rel_height=0.5)
    left, right = properties["left_bases"], properties["right_bases"]
    valleys = np.where(averaged[left] > averaged[right], left, right)
    independent = max(1.0, spectrum.frequencies[-1] / (cells * spectrum.resolution_hz))
    freedom = cells * spectrum.degrees_of_freedom
    tail = (1.0 - CONFIDENCE) / (2.0 * independent)
    high = scipy.stats.chi2.isf(tail, freedom[tops]) / freedom[tops]
    low = scipy.stats.chi2.ppf(tail, freedom[valleys]) / freedom[valleys]
    heights = properties["prominences"]
    kept = heights > 10.0 * np.log10(high / low)
    sides = properties["left_ips"][kept], properties["right_ips"][kept]
    return zip(tops[kept].tolist(), *sides, heights[kept], strict=True)
