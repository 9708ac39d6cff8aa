"""Check of the modes against the peaks of the output's spectrum."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evopem.signals.spectral.peaks import line_spacing
from evopem.validation.checks.check import Check

if TYPE_CHECKING:
    from evopem.estimation.model_record import ModelRecord
    from evopem.models.modes import Mode
    from evopem.signals.spectral.summary import SpectralPeak, SpectrumSummary

# Missed peaks that a statement lists.
MAX_LISTED = 6
# A mode accounts for no peak farther away than this share of its frequency.
MAX_RELATIVE_DISTANCE = 0.1
# Frequencies at which the gains of the model are searched for maxima.
GRID = 4096


def spectral_peaks(model: ModelRecord, spectrum: SpectrumSummary) -> Check:
    """A mode of the model near every peak of the output's spectrum."""
    name = "Every spectral peak modelled"
    frequencies = [peak.frequency_hz for peak in spectrum.peaks]
    if not frequencies:
        return Check(name, True, "The output's spectrum has no distinct peaks.")
    spacing = line_spacing(frequencies)
    if spacing is not None:
        return Check(
            name,
            None,
            f"The spectrum has {len(frequencies)} peaks about {spacing:.3g} Hz apart. These are the"
            " lines of a periodic input, among which resonances do not show as peaks.",
            "Compare the gain of the model with the multitaper estimate at the lines.",
        )
    resolution = spectrum.resolution_hz
    without_mode = [
        peak
        for peak in spectrum.peaks
        if not any(_accounts_for(mode, peak.frequency_hz, resolution) for mode in model.modes)
    ]
    missed = _unexplained(model, without_mode) if without_mode else []
    if not missed:
        return Check(
            name,
            True,
            f"Each of the {len(frequencies)} spectral peaks has a mode within the resolution of the"
            f" spectrum ({resolution:.2g} Hz) or within the mode's own bandwidth and uncertainty,"
            " or is no higher than a maximum of the model's gain and chance make it.",
        )
    listed = ", ".join(f"{frequency:.4g} Hz" for frequency in missed[:MAX_LISTED])
    if len(missed) > MAX_LISTED:
        listed += f" and {len(missed) - MAX_LISTED} more"
    return Check(
        name,
        False,
        f"{len(frequencies) - len(missed)} of {len(frequencies)} spectral peaks have a mode or"
        f" follow from the gain of the model. The model has nothing near {listed}.",
        "Raise the upper end of “orders.joint”, or check whether the peak is in the input already"
        " or caused by a transform.",
    )


def _accounts_for(mode: Mode, frequency: float, resolution: float) -> bool:
    """Whether a peak lies within the resolution, or the mode's half-power width or uncertainty.

    A mode with a damping ratio above 1/√2 has no resonance peak. A tenth of the mode's frequency
    is the limit, so that a broad or uncertain mode does not account for every peak.
    """
    centre, damping = mode.frequency_hz, abs(mode.damping_ratio)
    if damping > math.sqrt(0.5):
        return False
    error = mode.frequency_se_hz if math.isfinite(mode.frequency_se_hz) else 0.0
    width = min(max(damping * centre, 2.0 * error), MAX_RELATIVE_DISTANCE * centre)
    return abs(centre - frequency) <= max(resolution, width)


def _unexplained(model: ModelRecord, peaks: list[SpectralPeak]) -> list[float]:
    """Frequencies of the peaks that stand out more than a maximum of a gain and chance explain.

    A heavily damped mode and the zeros beside it make a broad maximum, away from the mode's own
    frequency, and chance moves the peak of the estimate about on it. So the maximum of ``|G|²`` or
    ``|H|²`` that a peak lies on is looked for: its prominence, less how far the gain has fallen
    from it at the peak's frequency, is what the model accounts for. The gain may have fallen by no
    more than the 95 % band of the estimate is wide. Each maximum accounts for one peak, the higher
    ones first.
    """
    grid = np.linspace(0.0, 0.5 * model.sampling_rate, GRID)
    gains = [
        10.0 * np.log10(np.maximum(np.abs(gain) ** 2, np.finfo(np.float64).tiny))
        for gain in (model.model.frequency_response(grid), model.model.noise_response(grid))
    ]
    used: set[tuple[int, int]] = set()
    unexplained = []
    for peak in sorted(peaks, key=lambda each: -each.prominence_db):
        index = int(np.argmin(np.abs(grid - peak.frequency_hz)))
        explained = {
            (which, top): height
            for which, gain in enumerate(gains)
            for top, height in _heights_at(index, gain).items()
            if (which, top) not in used and gain[top] - gain[index] <= _band_db(peak)
        }
        best = max(explained, key=lambda each: explained[each], default=None)
        height = max(0.0, explained[best]) if best is not None else 0.0
        if best is not None and height > 0.0:
            used.add(best)
        if peak.prominence_db - height > peak.chance_db:
            unexplained.append(peak.frequency_hz)
    return sorted(unexplained)


def _band_db(peak: SpectralPeak) -> float:
    """Width of the 95 % band of a density, in dB."""
    return 10.0 * math.log10(peak.upper / peak.lower)


def _heights_at(index: int, gain: NDArray[np.float64]) -> dict[int, float]:
    """For each maximum of a gain in dB, its prominence less its height above the gain at an index.

    The ends of the frequency axis may be maxima: nothing but their one side counts there.
    """
    from scipy.signal import find_peaks, peak_prominences

    tops, found = find_peaks(gain, prominence=0.0)
    prominences = dict(zip(tops.tolist(), found["prominences"].tolist(), strict=True))
    ends = [top for top, beside in ((0, 1), (-1, -2)) if gain[top] > gain[beside]]
    below = gain.min() - 1.0
    padded = np.concatenate([[below], gain, [below]])
    for top in (end % gain.size for end in ends):
        prominences[top] = float(peak_prominences(padded, [top + 1])[0][0])
    return {top: height - float(gain[top] - gain[index]) for top, height in prominences.items()}
