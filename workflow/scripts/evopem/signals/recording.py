"""One recording: an input and an output sampled together at a constant rate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.files.npz import load_arrays, save_arrays

LARGEST = 1e60
"""Magnitudes from here on, and below its inverse, do not leave room for the squares of residuals
that are ten digits smaller, or of gains from the least input to the greatest output."""

MINIMUM_SAMPLES = 8
"""A recording shorter than this cannot even be described, let alone identified."""


DESIGNED_LEVELS = 16
"""A signal of no more levels than these was made of levels."""
SATURATED_RUN = 3
"""So many equal samples on end at a signal's limit are no chance."""


@dataclass(frozen=True)
class Recording:
    """An input and an output sampled together at a constant rate.

    Attributes
    ----------
    input, output : ndarray of float64, shape (N,)
        The two signals, in their units.
    sampling_rate : float
        Samples a second (Hz).
    input_name, output_name : str
        What the channels are called.
    input_unit, output_unit : str
        Their units; an empty string means "not stated".
    """

    input: NDArray[np.float64]
    output: NDArray[np.float64]
    sampling_rate: float
    input_name: str = "input"
    output_name: str = "output"
    input_unit: str = ""
    output_unit: str = ""

    @property
    def samples(self) -> int:
        """Number of samples N of each signal."""
        return int(self.output.size)


def check_recording(recording: Recording, source: str = "recording") -> None:
    """Refuse a recording that nothing can be identified from.

    Parameters
    ----------
    recording : Recording
        The recording to look at; it is not changed.
    source : str
        The file or configuration key that an error names.

    Raises
    ------
    InputError
        When a signal is not one-dimensional, the lengths differ, there are fewer than
        `MINIMUM_SAMPLES` samples, a sample is not finite (the first one is named, counted
        from 1), a signal never changes, or is too large or too small to be squared, or the
        sampling rate is not a positive number.
    """
    signals = {
        f'input "{recording.input_name}"': recording.input,
        f'output "{recording.output_name}"': recording.output,
    }
    for channel, values in signals.items():
        if values.ndim != 1:
            raise InputError(
                source,
                f"the signal has {values.ndim} dimensions where one is needed",
                "choose a single channel",
                channel,
            )
    if recording.input.size != recording.output.size:
        raise InputError(
            source,
            f"the input has {recording.input.size} samples and the output {recording.output.size}",
            "choose two channels that were sampled together",
        )
    if recording.samples < MINIMUM_SAMPLES:
        raise InputError(
            source,
            f"there are only {recording.samples} samples",
            f"give a longer recording, of at least {MINIMUM_SAMPLES} samples",
        )
    for channel, values in signals.items():
        finite = np.isfinite(values)
        if not finite.all():
            first = int(np.argmin(finite))
            raise InputError(
                source,
                f"the value is {values[first]}, not a finite number",
                "repair the recording or cut that part away",
                f"{channel}, sample {first + 1}",
            )
        if np.ptp(values) == 0.0:
            raise InputError(
                source,
                f"every sample is {values[0]:g}, so there is nothing to identify",
                "choose a channel that varies",
                channel,
            )
        if not LARGEST**-1 < np.max(np.abs(values)) < LARGEST:
            raise InputError(
                source,
                f"the largest magnitude is {np.max(np.abs(values)):g}, with which the squares of"
                " small residuals leave the range of numbers",
                "record in another unit or scale the channel",
                channel,
            )
    if not (np.isfinite(recording.sampling_rate) and recording.sampling_rate > 0):
        raise InputError(
            source,
            f"the sampling rate is {recording.sampling_rate} Hz",
            "give a positive number of samples a second",
        )


def saturated_share(signal: NDArray[np.float64]) -> float:
    """Share of samples that stay at the signal's smallest or largest value for a while.

    Three equal samples on end at a limit are what a cut-off channel leaves; a measured one meets
    its extremes once. A signal of few levels, such as a random telegraph, is meant to stay there.
    """
    if np.unique(signal).size <= DESIGNED_LEVELS:
        return 0.0
    at_limit = (signal == signal.min()) | (signal == signal.max())
    starts = np.flatnonzero(np.diff(signal) != 0.0) + 1
    lengths = np.diff(np.concatenate(([0], starts, [signal.size])))
    stays = np.repeat(lengths >= SATURATED_RUN, lengths)
    return float(np.mean(at_limit & stays))


def save_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording to one ``.npz``, whole or not at all; equal recordings, equal bytes."""
    save_arrays(path, recording_arrays(recording))


def load_recording(path: str | Path) -> Recording:
    """Read a recording that `save_recording` wrote.

    Raises
    ------
    InputError
        When the file is missing or damaged.
    """
    return recording_from_arrays(load_arrays(path, recording_names()))


_FIELDS = (
    "input",
    "output",
    "sampling_rate",
    "input_name",
    "output_name",
    "input_unit",
    "output_unit",
)


def recording_arrays(recording: Recording, prefix: str = "") -> dict[str, NDArray]:
    """The fields of a recording as arrays, each name led by `prefix`."""
    return {prefix + field: np.asarray(getattr(recording, field)) for field in _FIELDS}


def describe_recording(recording: Recording) -> dict[str, Any]:
    """What a recording's provenance says of its samples: number, rate, names, units, saturation."""
    return {
        "samples": recording.samples,
        "sampling_rate": recording.sampling_rate,
        **{name: getattr(recording, name) for name in _FIELDS[3:]},
        "input_saturated_percent": 100.0 * saturated_share(recording.input),
        "output_saturated_percent": 100.0 * saturated_share(recording.output),
    }


def recording_names(prefix: str = "") -> tuple[str, ...]:
    """The names of the arrays that `recording_arrays` makes with this prefix."""
    return tuple(prefix + field for field in _FIELDS)


def recording_from_arrays(arrays: dict[str, NDArray], prefix: str = "") -> Recording:
    """Build the recording that `recording_arrays` took apart."""
    values = {field: arrays[prefix + field] for field in _FIELDS}
    return Recording(
        input=values["input"],
        output=values["output"],
        sampling_rate=float(values["sampling_rate"]),
        **{name: str(values[name]) for name in _FIELDS[3:]},
    )
