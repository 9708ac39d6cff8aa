"""Check of the modes against the peaks of the output's spectrum."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from evopem.signals.spectral.peaks import line_spacing
from evopem.validation.checks.check import Check

if TYPE_CHECKING:
    from evopem.estimation.model_record import ModelRecord
    from evopem.models.modes import Mode
    from evopem.signals.spectral.summary import SpectrumSummary
    from evopem.validation.peak_evidence import PeakEvidence

# Missed peaks that a statement lists.
MAX_LISTED = 6
# A mode accounts for no peak farther away than this share of its frequency.
MAX_RELATIVE_DISTANCE = 0.1


def spectral_peaks(
    model: ModelRecord, peaks: tuple[PeakEvidence, ...], spectrum: SpectrumSummary
) -> Check:
    """A mode near every peak of the output's spectrum, or a density there that the model gives."""
    name = "Every spectral peak modelled"
    frequencies = [peak.frequency_hz for peak in peaks]
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
    modes = (*model.modes, *model.noise_modes)
    # A NaN is no density that the model gives.
    missed = [
        peak
        for peak in peaks
        if not peak.excess <= peak.chance
        and not any(_accounts_for(mode, peak.frequency_hz, resolution) for mode in modes)
    ]
    if not missed:
        return Check(
            name,
            True,
            f"Each of the {len(frequencies)} spectral peaks has a mode within the resolution of the"
            f" spectrum ({resolution:.2g} Hz) or within the mode's own bandwidth and uncertainty,"
            " or is no higher than the model and chance make it.",
        )
    listed = ", ".join(map(_stated, missed[:MAX_LISTED]))
    if len(missed) > MAX_LISTED:
        listed += f" and {len(missed) - MAX_LISTED} more"
    return Check(
        name,
        False,
        f"{len(frequencies) - len(missed)} of {len(frequencies)} spectral peaks have a mode or"
        f" a density that follows from the model. The output has more power than the model gives it"
        f" at {listed}.",
        "Raise the upper end of “orders.joint”, or check whether the peak is in the input already"
        " or caused by a transform.",
    )


def _stated(peak: PeakEvidence) -> str:
    """A missed peak, and how much of its density the model lacks."""
    if not math.isfinite(peak.excess):
        return f"{peak.frequency_hz:.4g} Hz"
    return f"{peak.frequency_hz:.4g} Hz ({peak.excess:.2g} times)"


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
