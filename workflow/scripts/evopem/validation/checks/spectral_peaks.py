"""Check of the modes against the peaks of the output's spectrum."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from evopem.signals.peaks import line_spacing
from evopem.validation.checks.check import Check, Evidence

if TYPE_CHECKING:
    from evopem.models.modes import Mode
    from evopem.validation.peak_evidence import PeakEvidence

# Missed peaks that a statement lists.
MAX_LISTED = 6
# A mode accounts for no peak farther away than this share of its frequency.
MAX_RELATIVE_DISTANCE = 0.1


def spectral_peaks(evidence: Evidence) -> Check:
    """A mode near every peak of the outputs' spectra, or a density there that the model gives."""
    name, outputs = "Every spectral peak modelled", evidence.validation.outputs
    count = sum(len(each.peaks) for each in outputs)
    if not count:
        return Check(name, True, "The output's spectrum has no distinct peaks.")
    spacings = [line_spacing([peak.frequency_hz for peak in each.peaks]) for each in outputs]
    resolution = evidence.validation.resolution_hz
    modes = (*evidence.model.modes, *evidence.model.noise_modes)
    lines = [k for k, spacing in enumerate(spacings) if spacing is not None]
    if len(lines) == len(outputs):
        spacing = spacings[0] or 0.0
        return Check(
            name,
            None,
            f"The spectrum has {len(outputs[0].peaks)} peaks about {spacing:.3g} Hz apart. These"
            " are the lines of a periodic input, among which resonances do not show as peaks.",
            "Compare the gain of the model with the multitaper estimate at the lines.",
        )
    # A NaN is no density that the model gives.
    missed = [
        (peak, each.name)
        for k, each in enumerate(outputs)
        if k not in lines
        for peak in each.peaks
        if not peak.excess <= peak.chance
        and not any(_accounts_for(mode, peak.frequency_hz, resolution) for mode in modes)
    ]
    if not missed:
        return Check(
            name,
            True,
            f"Each of the {count} spectral peaks has a mode within the resolution of the"
            f" spectrum ({resolution:.2g} Hz) or within the mode's own bandwidth and uncertainty,"
            " or is no higher than the model and chance make it.",
        )
    stated = [
        _stated(peak) + (f" of {output}" if outputs[1:] else "")
        for peak, output in missed[:MAX_LISTED]
    ]
    more = f" and {len(missed) - MAX_LISTED} more" if len(missed) > MAX_LISTED else ""
    return Check(
        name,
        False,
        f"{count - len(missed)} of {count} spectral peaks have a mode or"
        " a density that follows from the model. The output has more power than the model gives it"
        f" at {', '.join(stated)}{more}.",
        f"Raise the upper end of “orders.{'joint' if evidence.model.orders else 'nx'}”, or check"
        " whether the peak is in the input already or caused by a transform.",
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
