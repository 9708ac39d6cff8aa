"""Wrong samples: single ones, which are replaced; a rest at the start, clipped and stuck ones."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from evopem.arrays import Array, Flags
from evopem.automatic.decision import Alternative, Decision
from evopem.signals.faulty_samples import LEAST_DEVIATION, without_outliers
from evopem.signals.prepared_data import StretchOrigin, Transforms
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import MAX_DESIGNED_LEVELS

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


# Samples that are kept of a rest before the first change: they tell the level of the rest.
KEPT_REST = 10
# Samples at a limit of the output, against those at the levels beside it.
CLIPPED_RATIO, CLIPPED_RUN, MOST_CLIPPED = 10.0, 5, 0.3
# Equal samples in sequence that stand still, the largest share of them, and the largest share of
# other samples that repeat the one before in a record where standing still means something.
STUCK_RUN, MOST_STUCK, REPEATED = 15, 0.5, 0.01


def decide_starts(recordings: Sequence[Recording]) -> tuple[tuple[int, ...], Decision]:
    """Leave out leading samples in which no channel has begun to change."""
    starts = []
    for recording in recordings:
        signals = np.column_stack([recording.inputs, recording.outputs])
        finite = np.isfinite(np.sum(signals, axis=1))
        still = (signals == signals[0]).all(axis=1) | ~finite
        leading = int(np.argmin(still)) if not still.all() else 0
        kept = max(leading - KEPT_REST, 0)
        starts.append(kept if finite[kept:leading].all() else leading)
    alternatives = tuple(Alternative(str(start), float(start)) for start in sorted({0, *starts}))
    sentence = "The record begins with its first sample; the transient is of the initial state."
    if any(starts):
        sentence = "Samples before the first change of any channel are left out."
    choice, criterion = ", ".join(map(str, starts)), "leading samples without any change"
    return tuple(starts), Decision("start", choice, alternatives, criterion, sentence)


def decide_clipping(
    recordings: Sequence[Recording], starts: Sequence[int]
) -> tuple[tuple[float, float], Decision]:
    """Breaks at a limit of the output where far more samples lie than beside it."""
    # A rest before the first change is not clipped.
    outputs = [
        recording.output[start + KEPT_REST if start else 0 :]
        for recording, start in zip(recordings, starts, strict=True)
    ]
    y = np.concatenate([output[np.isfinite(output)] for output in outputs])
    levels, counts = np.unique(y, return_counts=True)
    limits, alternatives = [-np.inf, np.inf], [Alternative("none", 0.0)]
    if levels.size > MAX_DESIGNED_LEVELS:
        for side, order in ((0, 1), (1, -1)):
            near = counts[::order][:6]
            share = near[0] / y.size
            ratio = float(near[0] / np.mean(near[1:]))
            runs = max(_longest_run(output, levels[::order][0]) for output in outputs)
            if ratio > CLIPPED_RATIO and runs >= CLIPPED_RUN and share < MOST_CLIPPED:
                limits[side] = float(levels[::order][0])
                alternatives.append(Alternative(f"at {limits[side]:g}", share))
    is_clipped = len(alternatives) > 1
    sentence = "No limit of the output holds more samples than the levels beside it."
    if is_clipped:
        sentence = "Clipped samples, many in sequence at a limit of the output, become breaks."
    choice = " and ".join(a.name for a in alternatives[1:]) if is_clipped else "none"
    criterion = "share of samples at the limit"
    about = Decision("clipping", choice, tuple(alternatives), criterion, sentence)
    return (limits[0], limits[1]), about


def decide_stuck(recordings: Sequence[Recording], starts: Sequence[int]) -> tuple[bool, Decision]:
    """Breaks where the output repeats one value for long, in a record without other repetitions."""
    outputs = [r.output[start:] for r, start in zip(recordings, starts, strict=True)]
    still = np.concatenate([standing_still(y) for y in outputs])
    repeated = np.concatenate([np.append(y[1:] == y[:-1], False) for y in outputs])
    share, others = float(np.mean(still)), float(np.mean(repeated & ~still))
    is_stuck = 0.0 < share < MOST_STUCK and others < REPEATED
    sentence = "No stretch in which the output stands still is distinguished from the rest."
    if share >= MOST_STUCK:
        sentence = f"The output stands still in {100 * share:.0f} % of samples: too many to cut."
    if is_stuck:
        sentence = "Long stretches of a still output, unlike elsewhere, become breaks."
    alternatives = (Alternative("no", others), Alternative("yes", share))
    criterion = "share of samples that repeat the one before: scattered ones, in long stretches"
    choice = "yes" if is_stuck else "no"
    return is_stuck, Decision("stuck samples", choice, alternatives, criterion, sentence)


def standing_still(signal: Array) -> Flags:
    """Samples in runs of at least ``STUCK_RUN`` equal values."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(signal) != 0.0) + 1, [len(signal)]])
    lengths = np.diff(edges)
    return np.repeat(lengths >= STUCK_RUN, lengths)


def _longest_run(signal: Array, value: float) -> int:
    at = np.concatenate([[0], (signal == value).astype(int), [0]])
    edges = np.flatnonzero(np.diff(at))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
