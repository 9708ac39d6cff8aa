"""A recording: inputs and outputs sampled together at a constant rate, in segments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from evopem.arrays import Array, columns
from evopem.errors import InputError
from evopem.files.atomic import load_arrays, save_arrays

MINIMUM_SAMPLES = 8  # a shorter recording is refused, whatever the model


def numbered(role: str, count: int, between: str = " ") -> tuple[str, ...]:
    """Names of channels without one: their role, of several with a number from 1."""
    names = (f"{role}{between}{n}" for n in range(1, count + 1))
    return tuple(names) if count > 1 else (role,) * count


class _Channels:
    """What recordings and segments have in common: columns of inputs and of outputs."""

    inputs: Array
    outputs: Array

    @property
    def samples(self) -> int:
        """Number of samples N of each channel."""
        return len(self.outputs)

    @property
    def has_input(self) -> bool:
        """Whether there is an input."""
        return self.inputs.shape[1] > 0

    @property
    def input(self) -> Array:
        """The only input, (N,); zeros without an input."""
        u = self.inputs if self.has_input else np.zeros(self.samples)
        return np.ascontiguousarray(columns(u, 1, "inputs")[:, 0])

    @property
    def output(self) -> Array:
        """The only output, (N,)."""
        return np.ascontiguousarray(columns(self.outputs, 1, "outputs")[:, 0])


@dataclass(frozen=True, eq=False)
class Segment(_Channels):
    """Consecutive samples of one recording."""

    inputs: Array  # (N, m) one-dimensional arrays become a single column; m = 0 without an input
    outputs: Array  # (N, l)
    # number of the recording, from 0.  Segments of one recording share their level; each segment
    # has its own initial state.
    recording: int = 0
    first: int = 0  # its first sample in the recording, which counts the missing ones

    def __post_init__(self) -> None:
        for role in ("inputs", "outputs"):
            object.__setattr__(self, role, columns(getattr(self, role)))

    def of_output(self, place: int) -> Self:
        """The same samples of one output, beside all inputs."""
        return replace(self, outputs=self.outputs[:, [place]])

    def between(self, first: int, stop: int) -> Self:
        """The samples from one to before another, counted from 0."""
        samples = self.inputs[first:stop], self.outputs[first:stop]
        return type(self)(*samples, self.recording, self.first + first)


def sample_times(segments: Sequence[Segment], lost: int = 0) -> list[Array]:
    """Times of the samples of each recording, in samples, less the ``lost`` first of each segment.

    A segment that begins before the last one ends is a recording of its own.
    """
    times: list[Array] = []
    for last, segment in zip([None, *segments], segments, strict=False):
        at = segment.first + np.arange(lost, segment.samples, dtype=float)
        if last is not None and last.recording == segment.recording and at[0] > times[-1][-1]:
            times[-1] = np.concatenate([times[-1], at])
        else:
            times.append(at)
    return times


def total_samples(segments: Sequence[Segment]) -> int:
    """Samples of all segments together."""
    return sum(segment.samples for segment in segments)


@dataclass(frozen=True, eq=False)
class Recording(_Channels):
    """Inputs and outputs sampled together at a constant rate.

    Several recordings of one system stand one after the other.  Nothing is predicted, filtered or
    differenced across the joint of two segments.

    Attributes
    ----------
    inputs : (N, m) array
        In their units; m = 0 without an input.  One-dimensional arrays become a single column.
    outputs : (N, l) array
    sampling_rate : float
        Samples a second (Hz).
    input_names, output_names : tuple of str
        What the channels are called, each name once; left out, "input" or "input 1", "input 2" …
    input_units, output_units : tuple of str
        An empty string means "not stated".
    segment_starts : tuple of int
        First sample of each segment of consecutive samples, from 0.
    segment_recordings : tuple of int
        Number of the recording that each segment is from; those of one share their level.
    segment_firsts : tuple of int
        First sample of each segment in its recording, which counts missing samples; left out, 0.

    Raises
    ------
    ValueError
        When inputs and outputs differ in length, channels lack a name or unit, or there is no rate.
    """

    inputs: Array
    outputs: Array
    sampling_rate: float
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    segment_starts: tuple[int, ...] = (0,)
    segment_recordings: tuple[int, ...] = (0,)
    segment_firsts: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if (given := len(self.inputs)) != self.samples:
            raise ValueError(f"{given} input samples, {self.samples} output samples")
        rate = np.asarray(self.sampling_rate)
        is_number = rate.ndim == 0 and rate.dtype.kind in "fiu"
        if not (is_number and np.isfinite(rate) and rate > 0.0):
            raise ValueError(f"sampling_rate must be a positive number of Hz, not {rate}")
        firsts = self.segment_firsts or (0,) * len(self.segment_starts)
        object.__setattr__(self, "segment_firsts", firsts)
        for role in ("input", "output"):
            values = columns(getattr(self, f"{role}s"))
            count = values.shape[1]
            names = getattr(self, f"{role}_names") or numbered(role, count)
            units = getattr(self, f"{role}_units") or ("",) * count
            if not len(names) == len(units) == count:
                raise ValueError(f"{count} {role}s, {len(names)} names and {len(units)} units")
            if len(set(names)) < count:
                raise ValueError(f"{role}s have one name twice: {', '.join(names)}")
            object.__setattr__(self, f"{role}s", values)
            object.__setattr__(self, f"{role}_names", names)
            object.__setattr__(self, f"{role}_units", units)

    @property
    def is_joined(self) -> bool:
        """Whether there is more than one segment of consecutive samples."""
        return len(self.segment_starts) > 1

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The segments of consecutive samples."""
        bounds = (*self.segment_starts, self.samples)
        return tuple(
            Segment(self.inputs[begin:stop], self.outputs[begin:stop], number, first)
            for (begin, stop), number, first in zip(
                pairwise(bounds), self.segment_recordings, self.segment_firsts, strict=True
            )
        )

    @property
    def separated(self) -> tuple[Self, ...]:
        """Each segment as a recording by itself."""
        return tuple(self.with_segments([replace(s, recording=0)]) for s in self.segments)

    @property
    def longest(self) -> Self:
        """The longest segment alone."""
        return max(self.separated, key=lambda record: record.samples)

    @property
    def times(self) -> Array:
        """Time (s) of each sample from the first one of its recording on, (N,)."""
        numbers = [segment.first + np.arange(segment.samples) for segment in self.segments]
        return np.concatenate(numbers) / self.sampling_rate

    def with_segments(self, segments: Sequence[Segment]) -> Self:
        """The same channels with other samples: these segments, one after the other."""
        lengths = [segment.samples for segment in segments]
        return replace(
            self,
            inputs=np.concatenate([segment.inputs for segment in segments]),
            outputs=np.concatenate([segment.outputs for segment in segments]),
            segment_starts=tuple(np.cumsum([0, *lengths[:-1]]).tolist()),
            segment_recordings=tuple(segment.recording for segment in segments),
            segment_firsts=tuple(segment.first for segment in segments),
        )

    def between(self, first: int, stop: int) -> Self:
        """The samples from one to before another, counted from 0, as one segment."""
        return self.with_segments([Segment(self.inputs[first:stop], self.outputs[first:stop])])

    @property
    def signals(self) -> dict[str, Array]:
        """Every channel, (N,), by what an error calls it."""
        names = [f'input "{name}"' for name in self.input_names]
        names += [f'output "{name}"' for name in self.output_names]
        return dict(zip(names, (*self.inputs.T, *self.outputs.T), strict=True))


def recording_of(
    input: ArrayLike | Recording | None,  # noqa: A002
    output: ArrayLike | None,
    sampling_rate: float,
) -> Recording:
    """Signals as a user gives them, as one recording; one is returned as it is. ValueError where a
    signal is missing, holds no finite real numbers, or differs in length or in its index."""
    if isinstance(input, Recording):
        if output is not None:
            raise ValueError("a Recording holds its outputs; give nothing as output")
        recording = input
    elif output is None:
        raise ValueError("the output is missing")
    else:
        paired_indexes(input, output, "input")
        y = samples_of(output, "output")
        u = np.empty((len(y), 0)) if input is None else samples_of(input, "input")
        if len(u) != len(y):
            raise ValueError(f"input and output must be of one length, not {len(u)} and {len(y)}")
        recording = Recording(u, y, sampling_rate)
    for name, signal in recording.signals.items():
        if not np.isfinite(signal).all():
            raise ValueError(f"{name} must be finite")
    return recording


def paired_indexes(input: Any, output: Any, source: str) -> list[Any]:  # noqa: A002
    """The indexes of the tables and series among two signals; InputError where two differ."""
    indexes = [frame.index for frame in (input, output) if hasattr(frame, "iloc")]
    if len(indexes) == 2 and not _are_equal(*indexes):
        raise InputError(
            source,
            "the indexes of input and output differ, and samples are not paired by position",
            "bring both to one index, as by pandas.concat([input, output], axis=1,"
            ' join="inner"), or give arrays',
        )
    return indexes


def _are_equal(first: Any, second: Any) -> bool:
    if len(first) != len(second) or first.equals(second):
        return len(first) == len(second)
    stamps = np.asarray(first), np.asarray(second)
    if any(stamp.dtype.kind != "f" or stamp.size < 2 for stamp in stamps):
        return False
    step = float(np.min(np.abs(np.diff(stamps[0]))))
    return bool(np.all(np.abs(stamps[0] - stamps[1]) <= 1e-6 * step))


def samples_of(given: Any, source: str, place: str = "") -> Array:
    """A copy of a signal as (N, channels), NaN where a sample is missing or masked.

    A row is the samples of one channel.  InputError for other numbers than real ones.
    """
    problem, remedy = "it holds no real numbers in one or two dimensions", "choose another signal"
    no_numbers = InputError(source, problem, f"{remedy}, or the real part of this one", place)
    try:
        is_table = hasattr(given, "to_numpy")
        is_real = np.asarray(given).dtype.kind in "fiubO"
        given = given.to_numpy(dtype=float, na_value=np.nan) if is_table else given
        samples = np.array(columns(given)) if is_real else None
    except (TypeError, ValueError):
        raise no_numbers from None
    if samples is None:
        raise no_numbers
    if not samples.size:
        raise InputError(source, "it has no samples", remedy, place)
    samples = samples.T if len(samples) == 1 else samples
    if samples.shape[1] > len(samples):
        problem = f"the signals have the shape {samples.shape}"
        remedy = "give samples in rows and channels in columns"
        raise InputError(source, problem, remedy, place)
    return samples


def concatenated(recordings: Sequence[Recording]) -> Recording:
    """Recordings of the same channels as one, each with a number of its own."""
    return recordings[0].with_segments(
        [
            replace(segment, recording=number)
            for number, recording in enumerate(recordings)
            for segment in recording.segments
        ]
    )


def save_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording to an ``.npz`` file, atomically; equal recordings give equal bytes."""
    save_recordings({"": recording}, path)


def load_recording(path: str | Path) -> Recording:
    """Read a recording that `save_recording` wrote."""
    (recording,) = load_recordings([""], path)
    return recording


_FIELDS = tuple(field.name for field in fields(Recording))


def save_recordings(recordings: Mapping[str, Recording], path: str | Path) -> None:
    """Write recordings to one ``.npz`` file, the names of their arrays after a prefix each."""
    arrays = {
        prefix + name: np.array(
            getattr(recording, name), str if name.endswith(("_names", "_units")) else None
        )
        for prefix, recording in recordings.items()
        for name in _FIELDS
    }
    save_arrays(path, arrays)


def load_recordings(prefixes: Sequence[str], path: str | Path) -> list[Recording]:
    """Read the recordings that `save_recordings` wrote under these prefixes."""
    arrays = load_arrays(path, tuple(prefix + name for prefix in prefixes for name in _FIELDS))
    recordings = []
    for prefix in prefixes:
        inputs, outputs, rate, *others = (arrays[prefix + name] for name in _FIELDS)
        listed = (tuple(further.tolist()) for further in others)
        recordings.append(Recording(inputs, outputs, float(rate), *listed))
    return recordings
