"""Several recordings of one system as one: joined where they agree, refused where they do not."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.recording import Recording, Segment, concatenated


def check_independent(
    estimation: Recording,
    validation: Recording,
    source: str,
    other: str = "the estimation recording",
    remedy: str = "give an independent recording, or leave the key out to cut this one",
) -> None:
    """Refuse a recording that is a copy of another one, or of a part.

    Each segment is compared with each.  ``other`` is what an error calls the first recording.
    """
    for one, two in itertools.product(estimation.segments, validation.segments):
        problem = _shared(one, two, other)
        if problem:
            raise InputError(source, problem, remedy)


def _shared(estimation: Segment, validation: Segment, other: str) -> str:
    """What two stretches have in common, in words; empty where nothing."""
    start = shared_start(_signals(estimation), _signals(validation))
    if start is None:
        return ""
    shorter = min(estimation.samples, validation.samples)
    part = f"samples {start + 1} to {start + shorter} of"
    if estimation.samples == validation.samples:
        return f"its samples are those of {other}"
    if validation.samples == shorter:
        return f"its samples are {part} {other}"
    return f"{part} it are {other}"


def shared_start(one: NDArray[np.float64], other: NDArray[np.float64]) -> int | None:
    """Find where all rows of the shorter array stand in the longer one; None where nowhere."""
    shorter, longer = sorted((one + 0.0, other + 0.0), key=len)  # no -0.0, whose bits differ
    # Searching bytes takes a time proportional to their number, however often samples repeat.
    width = shorter.itemsize * shorter.shape[1]
    content, sought = longer.tobytes(), shorter.tobytes()
    place = content.find(sought)
    while place % width > 0:  # between two samples; the modulus of -1 is positive as well
        if place < 0:
            return None
        place = content.find(sought, place + 1)
    return place // width


def _signals(recording: Segment) -> NDArray[np.float64]:
    return np.column_stack([recording.inputs, recording.outputs])


# Rates from the time stamps of equal clocks differ by no more than this share.
RATE_TOLERANCE = 1e-4
_TWICE = "give every recording of the data set once"


def joined(recordings: Sequence[Recording], sources: Sequence[str]) -> Recording:
    """Recordings of one system as one, each with its own number."""
    for number, (other, source) in enumerate(zip(recordings, sources, strict=True)):
        _check_alike(recordings[0], other, sources[0], source)
        for earlier, earlier_source in zip(recordings[:number], sources, strict=False):
            check_independent(earlier, other, source, earlier_source, _TWICE)
    return concatenated(recordings)


def _check_alike(first: Recording, other: Recording, first_source: str, source: str) -> None:
    """Refuse a recording of other channels, units or rate than the first one of a data set."""
    found = _in_common(other)
    for (what, key), expected in _in_common(first).items():
        own = found.get((what, key))
        if own != expected:
            raise InputError(
                source,
                f'the {what} is "{own}" here and "{expected}" in {first_source}',
                f"name under {key} what all recordings of the data set have, or take this file out"
                " of it",
            )
    if abs(other.sampling_rate - first.sampling_rate) > RATE_TOLERANCE * first.sampling_rate:
        raise InputError(
            source,
            f"its sampling rate is {other.sampling_rate:g} Hz and that of {first_source}"
            f" {first.sampling_rate:g} Hz",
            "give recordings of one rate, or correct sampling_rate or time",
        )


def _in_common(recording: Recording) -> dict[tuple[str, str], str]:
    """What recordings of one data set share, by what it is and the key that says it."""
    common: dict[tuple[str, str], str] = {}
    for role, names, units in (
        ("input", recording.input_names, recording.input_units),
        ("output", recording.output_names, recording.output_units),
    ):
        what = role if len(names) <= 1 else f"list of its {role}s"
        common[what, role] = ", ".join(names)
        for name, unit in zip(names, units, strict=True):
            called = role if len(names) == 1 else f"{role} {name}"
            common[f"unit of its {called}", f"{role}_unit"] = unit
    return common


def check_same_rate(recording: Recording, validation: Recording, source: str) -> None:
    """Refuse a validation recording of another rate than the estimation recording's."""
    if recording.sampling_rate != validation.sampling_rate:
        raise InputError(
            source,
            f"it was sampled at {validation.sampling_rate:g} Hz and the estimation recording at"
            f" {recording.sampling_rate:g} Hz",
            "validate on a recording of the same rate",
        )
