"""Single wrong samples of the outputs, replaced before anything else is decided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from evopem.automatic.decision import Alternative, Decision
from evopem.signals.outliers import LEAST_DEVIATION, without_outliers
from evopem.signals.prepared_data import StretchOrigin
from evopem.signals.recording import Recording

MOST_NAMED = 10  # times of replaced samples that a sentence names


def decide_outliers(
    recording: Recording, estimation: Sequence[StretchOrigin], prepared_rate: float
) -> tuple[Recording, Decision]:
    """Replace wrong samples among those for estimation; the others stay as they were recorded.

    `estimation`: Where the samples for estimation lie, at the prepared rate (Hz).
    """
    rate = recording.sampling_rate
    parts, rows = [], []
    for begin, segment in zip(recording.segment_starts, recording.segments, strict=True):
        for each in estimation:
            first = round(each.start * rate) - segment.first
            stop = min(first + round(each.samples * rate / prepared_rate), segment.samples)
            if each.recording == segment.recording and max(first, 0) < stop:
                parts.append(segment.between(max(first, 0), stop))
                rows.append(slice(begin + max(first, 0), begin + stop))
    cleaned = without_outliers(parts)
    outputs = recording.outputs.copy()
    times: list[str] = []
    for row, values, replaced in zip(rows, cleaned.outputs, cleaned.replaced, strict=True):
        outputs[row] = values
        times += [f"{each:.6g} s" for each in recording.times[row][replaced.any(axis=1)]]
    count, of = cleaned.total, sum(each.outputs.size for each in parts)
    if count:
        named = ", ".join(times[:MOST_NAMED]) + ", …" * (len(times) > MOST_NAMED)
        sentence = (
            f"{count} of {of} output samples for estimation are wrong alone, by more than"
            f" {LEAST_DEVIATION:g} standard errors from what the samples on both sides tell"
            f" (at {named}): they are replaced by that. Validation samples stay as recorded."
        )
    else:
        sentence = "No output sample is wrong alone."
    alternatives = (Alternative("none", 0.0), Alternative("replaced", float(count)))
    choice = "replaced" if count else "none"
    about = Decision("outliers", choice, alternatives, "number of wrong samples", sentence)
    return replace(recording, outputs=outputs), about
