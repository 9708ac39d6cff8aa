"""Single wrong samples of the outputs, replaced before anything else is decided."""

from collections.abc import Sequence
from dataclasses import replace

from evopem.automatic.decision import Alternative, Decision
from evopem.signals.outliers import LEAST_DEVIATION, without_outliers
from evopem.signals.prepared_data import StretchOrigin, Transforms
from evopem.signals.recording import Recording

MOST_NAMED = 10  # times of replaced samples that a sentence names


def decide_outliers(
    recording: Recording, validation: Recording | None, divided: Transforms
) -> tuple[Recording, Recording | None, Decision]:
    """Replace wrong samples of each part, found in it alone.

    `validation`: Recording of its own. `divided`: Where the samples of both parts lie.
    """
    rate, count_before = divided.sampling_rate, 1 + max(recording.segment_recordings)
    recording, fitted = _replaced(recording, divided.estimation, rate)
    later = [replace(o, recording=o.recording - count_before) for o in divided.validation]
    if validation is None:
        recording, held_out = _replaced(recording, divided.validation, rate)
    else:
        validation, held_out = _replaced(validation, later, rate)
    count = len(fitted) + len(held_out)
    sentence = "No output sample is wrong alone."
    if count:
        named = [f"{time:.6g} s" for time in (*fitted, *held_out)]
        sentence = (
            f"Output samples at {count} times are wrong alone, {len(held_out)} of them among those"
            f" for validation: off by more than {LEAST_DEVIATION:g} standard errors from the"
            f" prediction by the samples on both sides ({', '.join(named[:MOST_NAMED])}"
            f"{', …' * (count > MOST_NAMED)}). They are replaced by that."
        )
    alternatives = (Alternative("none", 0.0), Alternative("replaced", float(count)))
    choice = "replaced" if count else "none"
    about = Decision("outliers", choice, alternatives, "number of wrong samples", sentence)
    return recording, validation, about


def _replaced(
    recording: Recording, origins: Sequence[StretchOrigin], prepared_rate: float
) -> tuple[Recording, list[float]]:
    """A recording whose wrong samples at some places are replaced, and their times (s)."""
    rate, parts, rows = recording.sampling_rate, [], []
    for begin, segment in zip(recording.segment_starts, recording.segments, strict=True):
        for origin in origins:
            first = max(round(origin.start * rate) - segment.first, 0)
            end = round((origin.start + origin.samples / prepared_rate) * rate) - segment.first
            stop = min(end, segment.samples)
            if origin.recording == segment.recording and first < stop:
                parts.append(segment.between(first, stop))
                rows.append(slice(begin + first, begin + stop))
    if not parts:
        return recording, []
    cleaned = without_outliers(parts)
    outputs, times = recording.outputs.copy(), []
    for row, values, replaced in zip(rows, cleaned.outputs, cleaned.replaced, strict=True):
        outputs[row] = values
        times += recording.times[row][replaced.any(axis=1)].tolist()
    return replace(recording, outputs=outputs), times
