"""Sentences about the spectrum of the output."""

from __future__ import annotations

from evopem.report.numbers import THIN, count, enumeration, hertz, number, plural
from evopem.results.dataset import DatasetResults
from evopem.signals.spectral.peaks import line_spacing


def spectrum(results: DatasetResults) -> list[str]:
    """Peaks of the spectrum, and the order of A that they require."""
    summary = results.spectrum_summary
    segments = f", averaged over {count(summary.segments)} segments" if summary.segments > 1 else ""
    estimate = (
        "Thomson's multitaper estimate with time-halfbandwidth product"
        f" {number(summary.time_halfbandwidth)} ({summary.tapers} tapers) and transforms of"
        f" {count(summary.nfft)} points{segments} has a resolution of"
        f" {hertz(summary.resolution_hz)}."
    )
    frequencies = [peak.frequency_hz for peak in summary.peaks]
    if not frequencies:
        return [f"{estimate} It has no significant peak."]
    spacing = line_spacing(frequencies)
    if spacing is not None:
        return [
            f"{estimate} Its {count(len(frequencies))} significant peaks are about {hertz(spacing)}"
            " apart. They are the lines of a periodic input and do not indicate the number of"
            " modes."
        ]
    places = enumeration([hertz(frequency) for frequency in frequencies])
    heights = enumeration([f"{number(peak.prominence_db, 2)}{THIN}dB" for peak in summary.peaks])
    one = len(frequencies) == 1
    return [
        f"{estimate} It has {plural(len(frequencies), 'significant peak')}, at {places}, with"
        f" {'a prominence' if one else 'prominences'} of {heights}."
        f" {'It' if one else 'Each'} requires a pair of complex poles, so the order na is at least"
        f" {2 * len(frequencies)}."
    ]
