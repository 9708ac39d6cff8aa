"""One recording of several channels: inputs and outputs sampled together at a constant rate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evopem.files.npz import load_arrays, save_arrays
from evopem.signals.recording import Recording, check_measured, check_recording, without_input

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MultichannelRecording:
    """Inputs and outputs sampled together at a constant rate.

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
    """

    inputs: Array
    outputs: Array
    sampling_rate: float
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]

    @property
    def samples(self) -> int:
        """Number of samples N of each channel."""
        return len(self.outputs)

    @property
    def has_input(self) -> bool:
        """Whether there is an input."""
        return self.inputs.shape[1] > 0

    def between(self, first: int, stop: int) -> MultichannelRecording:
        """The samples from one to before another, counted from 0."""
        return replace(self, inputs=self.inputs[first:stop], outputs=self.outputs[first:stop])

    def channel(self, output: int, input: int | None = None) -> Recording:  # noqa: A002
        """One output, alone or with one input, as a recording of single channels."""
        alone = without_input(
            np.ascontiguousarray(self.outputs[:, output]),
            self.sampling_rate,
            self.output_names[output],
            self.output_units[output],
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
_TEXTS = ("input_names", "output_names", "input_units", "output_units")


def multichannel_arrays(recording: MultichannelRecording, prefix: str = "") -> dict[str, NDArray]:
    """The fields of a recording as arrays, each under its name after `prefix`."""
    numbers = {prefix + name: np.asarray(getattr(recording, name)) for name in _ARRAYS}
    texts = {prefix + name: np.array(getattr(recording, name), dtype=str) for name in _TEXTS}
    return numbers | texts


def multichannel_names(prefix: str = "") -> tuple[str, ...]:
    """The names of the arrays of `multichannel_arrays` with this prefix."""
    return tuple(prefix + name for name in (*_ARRAYS, *_TEXTS))


def multichannel_from_arrays(arrays: dict[str, NDArray], prefix: str = "") -> MultichannelRecording:
    """The recording whose fields `multichannel_arrays` gave as arrays."""
    texts = {name: tuple(map(str, arrays[prefix + name])) for name in _TEXTS}
    return MultichannelRecording(
        inputs=arrays[f"{prefix}inputs"],
        outputs=arrays[f"{prefix}outputs"],
        sampling_rate=float(arrays[f"{prefix}sampling_rate"]),
        **texts,
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
