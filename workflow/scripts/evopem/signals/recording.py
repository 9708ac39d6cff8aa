"""A recording: inputs and outputs sampled together at a constant rate, in segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.files.archive import load_arrays, save_arrays

Array = NDArray[np.float64]

MINIMUM_SAMPLES = 8
"""A shorter recording is refused, whatever the model."""


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
        return _single(self.inputs) if self.has_input else np.zeros(self.samples)

    @property
    def output(self) -> Array:
        """The only output, (N,)."""
        return _single(self.outputs)


@dataclass(frozen=True, eq=False)
class Segment(_Channels):
    """Consecutive samples of one recording."""

    inputs: Array  # (N, m) one-dimensional arrays become a single column; m = 0 without an input
    outputs: Array  # (N, l)
    # number of the recording, from 0.  Segments of one recording share their level; each segment
    # has its own initial state.
    recording: int = 0

    def __post_init__(self) -> None:
        for role in ("inputs", "outputs"):
            object.__setattr__(self, role, columns(getattr(self, role)))

    def between(self, first: int, stop: int) -> Segment:
        """The samples from one to before another, counted from 0."""
        return Segment(self.inputs[first:stop], self.outputs[first:stop], self.recording)


def total_samples(segments: Sequence[Segment]) -> int:
    """Samples of all segments together."""
    return sum(each.samples for each in segments)


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

    Raises
    ------
    ValueError
        When names or units are not one for each channel.
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

    def __post_init__(self) -> None:
        for role in ("input", "output"):
            values = columns(getattr(self, f"{role}s"))
            count = values.shape[1]
            numbered = (role,) if count == 1 else tuple(f"{role} {n + 1}" for n in range(count))
            names = getattr(self, f"{role}_names") or numbered
            units = getattr(self, f"{role}_units") or ("",) * count
            if not len(names) == len(units) == count:
                raise ValueError(f"{count} {role}s, {len(names)} names and {len(units)} units")
            object.__setattr__(self, f"{role}s", values)
            object.__setattr__(self, f"{role}_names", names)
            object.__setattr__(self, f"{role}_units", units)

    @property
    def is_joined(self) -> bool:
        """Whether there is more than one segment of consecutive samples."""
        return len(self.segment_starts) > 1

    @property
    def bounds(self) -> tuple[int, ...]:
        """First sample of each segment, and N."""
        return (*self.segment_starts, self.samples)

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The segments of consecutive samples."""
        return tuple(
            Segment(self.inputs[first:stop], self.outputs[first:stop], number)
            for (first, stop), number in zip(
                pairwise(self.bounds), self.segment_recordings, strict=True
            )
        )

    @property
    def separated(self) -> tuple[Recording, ...]:
        """Each segment as a recording by itself."""
        return tuple(self.between(first, stop) for first, stop in pairwise(self.bounds))

    @property
    def longest(self) -> Recording:
        """The longest segment alone."""
        return max(self.separated, key=lambda each: each.samples)

    def with_segments(self, segments: Sequence[Segment]) -> Recording:
        """The same channels with other samples: these segments, one after the other."""
        lengths = [each.samples for each in segments]
        return replace(
            self,
            inputs=np.concatenate([each.inputs for each in segments]),
            outputs=np.concatenate([each.outputs for each in segments]),
            segment_starts=tuple(np.cumsum([0, *lengths[:-1]]).tolist()),
            segment_recordings=tuple(each.recording for each in segments),
        )

    def between(self, first: int, stop: int) -> Recording:
        """The samples from one to before another, counted from 0, as one segment."""
        return replace(
            self,
            inputs=self.inputs[first:stop],
            outputs=self.outputs[first:stop],
            segment_starts=(0,),
            segment_recordings=(0,),
        )

    @property
    def signals(self) -> dict[str, Array]:
        """Every channel, (N,), by what an error calls it."""
        return {
            f'{role} "{name}"': values
            for role, names, channels in (
                ("input", self.input_names, self.inputs),
                ("output", self.output_names, self.outputs),
            )
            for name, values in zip(names, channels.T, strict=True)
        }


def recording_of(
    input: ArrayLike | Recording | None,  # noqa: A002
    output: ArrayLike | None,
    sampling_rate: float,
) -> Recording:
    """Signals as a user gives them, as one recording; one is returned as it is.

    Raises
    ------
    ValueError
        When a signal is missing, complex, or of another length, or the rate is no number of Hz.
    """
    if isinstance(input, Recording):
        if output is not None:
            raise ValueError("a Recording holds its outputs; give nothing as output")
        return input
    if output is None:
        raise ValueError("the output is missing")
    given = np.asarray(output)
    signals = {"input": np.empty((len(given), 0)) if input is None else input, "output": given}
    for name, signal in signals.items():
        if np.iscomplexobj(signal):
            raise ValueError(f"the {name} is complex; give its real part or another channel")
    u, y = (np.ascontiguousarray(each, dtype=float) for each in signals.values())
    if len(u) != len(y):
        raise ValueError(f"input and output must be of one length, not {len(u)} and {len(y)}")
    if not (np.isfinite(sampling_rate) and sampling_rate > 0.0):
        raise ValueError(f"sampling_rate must be a positive number of Hz, not {sampling_rate}")
    return Recording(u, y, sampling_rate)


def columns(values: Array) -> Array:
    """Samples as an (N, channels) array of float64; a one-dimensional array is one column."""
    found = np.asarray(values, dtype=np.float64)
    return found[:, None] if found.ndim == 1 else found


def _single(values: Array) -> Array:
    if values.shape[1] != 1:
        raise ValueError(f"{values.shape[1]} channels where one is needed")
    return np.ascontiguousarray(values[:, 0])


def concatenated(recordings: Sequence[Recording]) -> Recording:
    """Recordings of the same channels as one, each with a number of its own."""
    return recordings[0].with_segments(
        [
            replace(segment, recording=number)
            for number, each in enumerate(recordings)
            for segment in each.segments
        ]
    )


def without_input(
    outputs: Array, sampling_rate: float, name: str = "", unit: str = ""
) -> Recording:
    """A recording of outputs alone, (N,) or (N, l); name and unit are those of a single one."""
    names, units = ((name,) if name else ()), ((unit,) if unit else ())
    empty = np.empty((len(outputs), 0))
    return Recording(empty, outputs, sampling_rate, (), names, (), units)


def save_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording to an ``.npz`` file, atomically; equal recordings give equal bytes."""
    save_arrays(path, recording_arrays(recording))


def load_recording(path: str | Path) -> Recording:
    """Read a recording that `save_recording` wrote."""
    return recording_from_arrays(load_arrays(path, recording_names()))


_NUMBERS = ("inputs", "outputs", "sampling_rate")
_TEXTS = ("input_names", "output_names", "input_units", "output_units")
_SEGMENTS = ("segment_starts", "segment_recordings")


def recording_arrays(recording: Recording, prefix: str = "") -> dict[str, NDArray]:
    """The fields of a recording as arrays, each under its name after `prefix`."""
    numbers = {prefix + name: np.asarray(getattr(recording, name)) for name in _NUMBERS + _SEGMENTS}
    return numbers | {prefix + name: np.array(getattr(recording, name), str) for name in _TEXTS}


def recording_names(prefix: str = "") -> tuple[str, ...]:
    """The names of the arrays of `recording_arrays` with this prefix."""
    return tuple(prefix + name for name in (*_NUMBERS, *_SEGMENTS, *_TEXTS))


def recording_from_arrays(arrays: dict[str, NDArray], prefix: str = "") -> Recording:
    """The recording whose fields `recording_arrays` gave as arrays."""
    return Recording(
        inputs=arrays[f"{prefix}inputs"],
        outputs=arrays[f"{prefix}outputs"],
        sampling_rate=float(arrays[f"{prefix}sampling_rate"]),
        segment_starts=tuple(arrays[f"{prefix}segment_starts"].tolist()),
        segment_recordings=tuple(arrays[f"{prefix}segment_recordings"].tolist()),
        **{name: tuple(map(str, arrays[prefix + name])) for name in _TEXTS},
    )
