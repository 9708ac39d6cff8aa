"""Refuse recordings from which nothing can be identified, and those that do not belong together."""

import itertools
from collections.abc import Sequence

import numpy as np

from evopem.arrays import Array
from evopem.errors import InputError
from evopem.signals.recording import MINIMUM_SAMPLES, Recording, concatenated

LARGEST = 1e60
"""A signal's largest magnitude must be below this and above its inverse: the squares of residuals
that are ten digits smaller, and the gain between two such signals, then stay finite."""

MAX_DESIGNED_LEVELS = 16
"""A signal of at most this many levels, such as a random telegraph, was made of levels."""

SWITCHED = 1.0 / 3.0
"""An input with more than this share of its samples at each limit is switched between them."""

MIN_SATURATED_RUN = 3  # this many equal samples in sequence at a signal's limit count as saturated
# In coarse steps a parabola's top is 2 / (sqrt(2) - 1) times as long as a level beside it at most.
TOP_OF_WAVE = 4.83

LARGEST_STUCK_SHARE = 0.9
"""A measured output with more than this share of its samples at one value, or at its two limits,
is refused. A smaller share is stated in the report."""

RATE_TOLERANCE = 1e-4
"""Rates from the time stamps of equal clocks differ by no more than this share."""


def check_recording(
    recording: Recording, source: str, constant_input: bool = False, measured: bool = False
) -> None:
    """Refuse a recording from which no model can be identified.

    With ``constant_input`` inputs may rest: after a step or a blow a model can still be validated
    by its free response; in a ``measured`` recording, whose outputs must move, one beside others.
    """
    if recording.samples < MINIMUM_SAMPLES:
        remedy = f"give a longer recording, of at least {MINIMUM_SAMPLES} samples"
        raise InputError(source, f"there are only {recording.samples} samples", remedy)
    inputs = recording.inputs.shape[1]
    leave = "leave it out or " * (max(inputs, recording.outputs.shape[1]) > 1)
    for number, (channel, values) in enumerate(recording.signals.items()):
        problem, remedy, place = "", "", channel
        finite = np.isfinite(values)
        largest = np.max(np.abs(values))
        if not finite.all():
            first = int(np.argmin(finite))
            problem = f"the value is {values[first]}, not a finite number"
            remedy, place = "cut that part away", f"{channel}, sample {first + 1}"
        elif np.ptp(values) == 0.0:
            may_rest = constant_input or (measured and np.ptp(recording.inputs, axis=0).any())
            if number >= inputs or not may_rest:
                problem = f"every sample is {values[0]:g}, so there is nothing to identify"
                remedy = f"{leave}choose a channel that varies"
        elif not 1.0 / LARGEST < largest < LARGEST:
            problem = (
                f"the largest magnitude is {largest:g}, with which the squares of small residuals"
                " leave the range of numbers"
            )
            remedy = "record in another unit or scale the channel"
        elif measured and number >= inputs:
            problem = _stuck(values)
            remedy = f"{leave}record again within the instrument's range, or cut that part away"
        if problem:
            raise InputError(source, problem, remedy, place)


def _stuck(values: Array) -> str:
    """Why an output hardly ever changes; empty where it does."""
    levels, counts = np.unique(values, return_counts=True)
    usual = int(np.argmax(counts))
    at_limits = np.count_nonzero((values == levels[0]) | (values == levels[-1]))
    for equal, where in (
        (counts[usual], f"are the same value, {levels[usual]:g}"),
        (at_limits, f"lie at its smallest or largest value, {levels[0]:g} or {levels[-1]:g}"),
    ):
        if equal > LARGEST_STUCK_SHARE * values.size:
            share = f"{100 * equal / values.size:.1f} % of its samples {where}"
            return f"{share}, so the channel was saturated, cut off or hardly ever changed"
    return ""


def saturated_share(signal: Array, is_input: bool = False) -> float:
    """Share of samples in runs of `MIN_SATURATED_RUN` or more at the smallest or largest value.

    0 for a signal of at most `MAX_DESIGNED_LEVELS` levels, and for one that is held at most of its
    other values, such as random steps.  Coarse steps of an instrument hold two other values or more
    for as long, and stay at the top of a wave.  The first run is rest before something acts.  An
    input at 0 is switched off, and one that is mostly at both limits is switched between them.
    """
    at_limits = [np.mean(signal == limit) for limit in (signal.min(), signal.max())]
    switched = is_input and min(at_limits) > SWITCHED
    if switched or np.unique(signal).size <= MAX_DESIGNED_LEVELS:
        return 0.0
    starts = np.flatnonzero(np.diff(signal, prepend=np.nan) != 0.0)
    lengths = np.diff(np.append(starts, signal.size))
    at_limit = np.isin(signal[starts], (signal.min(), signal.max()))
    others, least = np.sort(lengths[~at_limit]), MIN_SATURATED_RUN
    if np.sum(others[others >= least]) > 0.5 * np.sum(others):
        return 0.0
    changes, padded = np.abs(np.diff(signal[starts])), np.pad(lengths, 1)
    near = np.pad(changes < 1.5 * changes.min(), 1, constant_values=True)
    longest = TOP_OF_WAVE * np.maximum(padded[:-2], padded[2:])
    at_limit &= ~(near[:-1] & near[1:] & (lengths <= longest))
    at_limit[0] = False
    at_limit &= (signal[starts] != 0.0) | (not is_input)
    stays = lengths >= max([least, *(others[-2:-1] + 1)])
    return float(np.sum(lengths[at_limit & stays])) / signal.size


def joined(recordings: Sequence[Recording], sources: Sequence[str]) -> Recording:
    """Recordings of one system as one, each with its own number; refused where they disagree."""
    expected = _in_common(recordings[0])
    for number, (recording, source) in enumerate(zip(recordings, sources, strict=True)):
        common = _in_common(recording)
        for (what, key), value in expected.items():
            if common.get((what, key)) != value:
                here = f'"{common.get((what, key))}" here and "{value}" in {sources[0]}'
                remedy = f"name under {key} what all recordings have, or leave this file out"
                raise InputError(source, f"the {what} is {here}", remedy)
        _check_rate(recordings[0], recording, source, sources[0])
        once = "give every recording of the data set once"
        for earlier, earlier_source in zip(recordings[:number], sources, strict=False):
            check_independent(earlier, recording, source, earlier_source, once)
    return concatenated(recordings)


def _in_common(recording: Recording) -> dict[tuple[str, str], str]:
    """What recordings of one data set share, by what it is and the key that says it."""
    common: dict[tuple[str, str], str] = {}
    for role in ("input", "output"):
        names, units = getattr(recording, f"{role}_names"), getattr(recording, f"{role}_units")
        alone = len(names) <= 1
        common[role if alone else f"list of its {role}s", role] = ", ".join(names)
        for name, unit in zip(names, units, strict=True):
            common[f"unit of its {role}{'' if alone else f' {name}'}", f"{role}_unit"] = unit
    return common


def _check_rate(first: Recording, second: Recording, source: str, first_source: str) -> None:
    if abs(second.sampling_rate - first.sampling_rate) > RATE_TOLERANCE * first.sampling_rate:
        rates = f"{second.sampling_rate:g} Hz and that of {first_source} {first.sampling_rate:g} Hz"
        remedy = "give recordings of one rate, or correct sampling_rate or time"
        raise InputError(source, f"its sampling rate is {rates}", remedy)


def check_validation(recording: Recording, validation: Recording, source: str) -> None:
    """Refuse a validation recording of another rate, of other channels, or of the same samples."""
    _check_rate(recording, validation, source, "the estimation recording")
    for role in ("inputs", "outputs"):
        expected, given = (getattr(record, role).shape[1] for record in (recording, validation))
        if given != expected:
            problem = f"it has {given} {role} and the estimation recording {expected}"
            raise InputError(source, problem, "validate on a recording of the same channels")
    check_independent(recording, validation, source)


def check_independent(
    estimation: Recording,
    validation: Recording,
    source: str,
    whose: str = "the estimation recording",
    remedy: str = "give an independent recording, or leave the key out to cut this one",
) -> None:
    """Refuse a recording with a segment that is a copy of one of another, or of a part of it."""
    for first, second in itertools.product(estimation.segments, validation.segments):
        start = shared_start(*(np.column_stack([r.inputs, r.outputs]) for r in (first, second)))
        if start is None:
            continue
        shorter = min(first.samples, second.samples)
        part = f"samples {start + 1} to {start + shorter} of"
        if first.samples == second.samples:
            problem = f"its samples are those of {whose}"
        elif second.samples == shorter:
            problem = f"its samples are {part} {whose}"
        else:
            problem = f"{part} it are {whose}"
        raise InputError(source, problem, remedy)


def shared_start(first: Array, second: Array) -> int | None:
    """Find where all rows of the shorter array stand in the longer one; None where nowhere."""
    shorter, longer = sorted((first + 0.0, second + 0.0), key=len)  # no -0.0, whose bits differ
    # Searching bytes takes a time proportional to their number, however often samples repeat.
    width = shorter.itemsize * shorter.shape[1]
    content, sought = longer.tobytes(), shorter.tobytes()
    place = content.find(sought)
    while place % width > 0:  # between two samples; the modulus of -1 is positive as well
        if place < 0:
            return None
        place = content.find(sought, place + 1)
    return place // width
