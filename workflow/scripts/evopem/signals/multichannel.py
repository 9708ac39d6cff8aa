"""Recordings of several channels: inputs and outputs sampled together at a constant rate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evopem.files.npz import load_arrays, save_arrays
from evopem.signals.recording import (
    MINIMUM_SAMPLES,
    Recording,
    check_measured,
    check_recording,
    without_input,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MultichannelRecording:
    """Inputs and outputs sampled together at a constant rate.

    Several recordings of one system stand one after the other.  Nothing is predicted, filtered or
    correlated across the joint of two.

    Attributes
    ----------
    inputs : (N, nu) array
        In their units; nu = 0 without an input.
    outputs : (N, ny) array
    sampling_rate : float
        Hz.
    input_names, output_names : tuple of str
        What the channels are called, each name once.
    input_units, output_units : tuple of str
        An empty string means "not stated".
    starts : tuple of int
        First sample of each recording, from 0.
    """

    inputs: Array
    outputs: Array
    sampling_rate: float
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    starts: tuple[int, ...] = (0,)

    @property
    def samples(self) -> int:
        """Number of samples N of each channel, of all recordings."""
        return len(self.outputs)

    @property
    def has_input(self) -> bool:
        """Whether there is an input."""
        return self.inputs.shape[1] > 0

    @property
    def is_joined(self) -> bool:
        """Whether there is more than one recording."""
        return len(self.starts) > 1

    @property
    def bounds(self) -> tuple[int, ...]:
        """First sample of each recording, and N."""
        return (*self.starts, self.samples)

    @property
    def records(self) -> tuple[MultichannelRecording, ...]:
        """Each recording by itself."""
        return tuple(self.between(first, stop) for first, stop in pairwise(self.bounds))

    @property
    def longest(self) -> MultichannelRecording:
        """The longest recording alone."""
        return max(self.records, key=lambda each: each.samples)

    @property
    def input_records(self) -> list[Array]:
        """Inputs of each recording, (N, nu) arrays."""
        return [each.inputs for each in self.records]

    @property
    def output_records(self) -> list[Array]:
        """Outputs of each recording, (N, ny) arrays."""
        return [each.outputs for each in self.records]

    def with_records(self, records: Sequence[MultichannelRecording]) -> MultichannelRecording:
        """The same channels with other samples, at their rate: those of recordings, in order."""
        lengths = [each.samples for each in records]
        return replace(
            self,
            inputs=np.concatenate([each.inputs for each in records]),
            outputs=np.concatenate([each.outputs for each in records]),
            sampling_rate=records[0].sampling_rate,
            starts=tuple(np.cumsum([0, *lengths[:-1]]).tolist()),
        )

    def first_samples(self, most: int) -> MultichannelRecording:
        """The first samples of each recording, in proportion to its length, ``most`` together."""
        if self.samples <= most:
            return self
        return self.with_records(
            [
                each.between(0, max(each.samples * most // self.samples, MINIMUM_SAMPLES))
                for each in self.records
            ]
        )

    def between(self, first: int, stop: int) -> MultichannelRecording:
        """The samples from one to before another, counted from 0, as one recording."""
        return replace(
            self, inputs=self.inputs[first:stop], outputs=self.outputs[first:stop], starts=(0,)
        )

    def channel(self, output: int, input: int | None = None) -> Recording:  # noqa: A002
        """One output, alone or with one input, as a recording of single channels."""
        alone = replace(
            without_input(
                np.ascontiguousarray(self.outputs[:, output]),
                self.sampling_rate,
                self.output_names[output],
                self.output_units[output],
            ),
            stretch_starts=self.starts,
            stretch_recordings=tuple(range(len(self.starts))),
        )
        if input is None:
            return alone
        return replace(
            alone,
            input=np.ascontiguousarray(self.inputs[:, input]),
            input_name=self.input_names[input],
            input_unit=self.input_units[input],
        )

    def pairs(self) -> Iterator[Recording]:
        """Recordings of single channels in which every channel stands at least once."""
        for output in range(self.outputs.shape[1]):
            inputs = self.inputs.shape[1]
            yield self.channel(output, output % inputs if inputs else None)
        for input_ in range(self.outputs.shape[1], self.inputs.shape[1]):
            yield self.channel(0, input_)


def check_multichannel(recording: MultichannelRecording, source: str, measured: bool) -> None:
    """Refuse a recording in which any channel is one from which nothing can be identified.

    Parameters
    ----------
    recording : MultichannelRecording
    source : str
        The file or configuration key that an error names.
    measured : bool
        Whether overflow codes and stuck outputs are looked for, too.

    Raises
    ------
    InputError
        Naming the channel; see :func:`.check_recording` and :func:`.check_measured`.
    """
    for pair in recording.pairs():
        check_recording(pair, source)
        if measured:
            check_measured(pair, source)


_ARRAYS = ("inputs", "outputs", "sampling_rate")
_STARTS = "starts"
_TEXTS = ("input_names", "output_names", "input_units", "output_units")


def multichannel_arrays(recording: MultichannelRecording, prefix: str = "") -> dict[str, NDArray]:
    """The fields of a recording as arrays, each under its name after `prefix`."""
    numbers = {prefix + name: np.asarray(getattr(recording, name)) for name in _ARRAYS}
    texts = {prefix + name: np.array(getattr(recording, name), dtype=str) for name in _TEXTS}
    return numbers | texts | {prefix + _STARTS: np.array(recording.starts)}


def multichannel_names(prefix: str = "") -> tuple[str, ...]:
    """The names of the arrays of `multichannel_arrays` with this prefix."""
    return tuple(prefix + name for name in (*_ARRAYS, *_TEXTS, _STARTS))


def multichannel_from_arrays(arrays: dict[str, NDArray], prefix: str = "") -> MultichannelRecording:
    """The recording whose fields `multichannel_arrays` gave as arrays."""
    texts = {name: tuple(map(str, arrays[prefix + name])) for name in _TEXTS}
    return MultichannelRecording(
        inputs=arrays[f"{prefix}inputs"],
        outputs=arrays[f"{prefix}outputs"],
        sampling_rate=float(arrays[f"{prefix}sampling_rate"]),
        **texts,
        starts=tuple(arrays[prefix + _STARTS].tolist()),
    )


def save_multichannel(recording: MultichannelRecording, path: str | Path) -> None:
    """Write a recording to an ``.npz`` file, atomically; equal recordings give equal bytes."""
    save_arrays(path, multichannel_arrays(recording))


def load_multichannel(path: str | Path) -> MultichannelRecording:
    """Read a recording that `save_multichannel` wrote.

    Raises
    ------
    InputError
        When the file is missing or damaged.
    """
    return multichannel_from_arrays(load_arrays(path, multichannel_names()))
