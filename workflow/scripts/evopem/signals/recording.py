"""One recording: an input and an output sampled together at a constant rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.files.npz import load_arrays, save_arrays
from evopem.signals.stretches import Stretch

LARGEST = 1e60
"""A signal's largest magnitude must be below this and above its inverse: the squares of residuals
that are ten digits smaller, and the gain between two such signals, then stay finite."""

MINIMUM_SAMPLES = 8
"""A shorter recording is refused, whatever the model."""

MAX_DESIGNED_LEVELS = 16
"""A signal of at most this many levels, such as a random telegraph, was made of levels."""

MIN_SATURATED_RUN = 3
"""This many equal samples in sequence at a signal's limit count as saturated."""

LARGEST_STUCK_SHARE = 0.9
"""A measured output with more than this share of its samples at one value, or at its two limits,
is refused. A smaller share is stated in the report."""

OVERFLOW_CODES = (9.9e37, 9.91e37, float(np.finfo(np.float32).max), 9.969209968386869e36)
"""Numbers for overflow and "not a number" in SCPI (1999, 7.2.1), the largest number of single
precision, and the value that netCDF fills in."""


@dataclass(frozen=True)
class Recording:
    """An input and an output sampled together at a constant rate.

    Several recordings of one system stand one after the other.  Nothing is predicted, filtered or
    differenced across the joint of two stretches.

    Attributes
    ----------
    input, output : ndarray of float64, shape (N,)
        The two signals, in their units.  Without an input, ``input`` is zero and has no name.
    sampling_rate : float
        Samples a second (Hz).
    input_name, output_name : str
        What the channels are called.
    input_unit, output_unit : str
        Their units; an empty string means "not stated".
    stretch_starts : tuple of int
        First sample of each stretch of consecutive samples, from 0.
    stretch_recordings : tuple of int
        Number of the recording that each stretch is from; those of one share their level.
    """

    input: NDArray[np.float64]
    output: NDArray[np.float64]
    sampling_rate: float
    input_name: str = "input"
    output_name: str = "output"
    input_unit: str = ""
    output_unit: str = ""
    stretch_starts: tuple[int, ...] = (0,)
    stretch_recordings: tuple[int, ...] = (0,)

    @property
    def samples(self) -> int:
        """Number of samples N of each signal."""
        return int(self.output.size)

    @property
    def has_input(self) -> bool:
        """Whether there is an input."""
        return bool(self.input_name)

    @property
    def is_joined(self) -> bool:
        """Whether there is more than one stretch of consecutive samples."""
        return len(self.stretch_starts) > 1

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        """The stretches of consecutive samples."""
        ends = (*self.stretch_starts[1:], self.samples)
        return tuple(
            Stretch(self.input[begin:end], self.output[begin:end], recording)
            for begin, end, recording in zip(
                self.stretch_starts, ends, self.stretch_recordings, strict=True
            )
        )

    def with_stretches(self, stretches: Sequence[Stretch]) -> Recording:
        """The same channels with other samples: these stretches, one after the other."""
        lengths = [each.samples for each in stretches]
        return replace(
            self,
            input=np.concatenate([each.input for each in stretches]),
            output=np.concatenate([each.output for each in stretches]),
            stretch_starts=tuple(np.cumsum([0, *lengths[:-1]]).tolist()),
            stretch_recordings=tuple(each.recording for each in stretches),
        )

    @property
    def longest(self) -> Recording:
        """The longest stretch alone."""
        longest = max(self.stretches, key=lambda each: each.samples)
        return self.with_stretches([replace(longest, recording=0)])

    @property
    def signals(self) -> dict[str, NDArray[np.float64]]:
        """The signals there are, by what an error calls them."""
        output = {f'output "{self.output_name}"': self.output}
        return {f'input "{self.input_name}"': self.input} | output if self.has_input else output


def without_input(
    output: NDArray[np.float64], sampling_rate: float, name: str = "output", unit: str = ""
) -> Recording:
    """A recording of an output alone."""
    return Recording(
        input=np.zeros_like(output),
        output=output,
        sampling_rate=sampling_rate,
        input_name="",
        output_name=name,
        output_unit=unit,
    )


def check_recording(
    recording: Recording, source: str = "recording", constant_input: bool = False
) -> None:
    """Refuse a recording from which no model can be identified.

    Parameters
    ----------
    recording : Recording
        The recording to check.
    source : str
        The file or configuration key that an error names.
    constant_input : bool
        Whether the input may rest: after a step or a blow a model can still be validated by its
        free response.

    Raises
    ------
    InputError
        When a signal is not one-dimensional, the lengths differ, there are fewer than
        `MINIMUM_SAMPLES` samples, a sample is not finite (the first one is named, counted
        from 1), a signal never changes, or is too large or too small to be squared, or the
        sampling rate is not a positive number.
    """
    signals = recording.signals
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
        _check_signal(values, source, channel, constant_input and values is recording.input)
    if not (np.isfinite(recording.sampling_rate) and recording.sampling_rate > 0):
        raise InputError(
            source,
            f"the sampling rate is {recording.sampling_rate} Hz",
            "give a positive number of samples a second",
        )


def _check_signal(
    values: NDArray[np.float64], source: str, channel: str, may_be_constant: bool = False
) -> None:
    """Refuse samples that are not finite, never change, or cannot be squared."""
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
        if may_be_constant:
            return
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


def check_measured(recording: Recording, source: str) -> None:
    """Refuse a measured recording with overflow codes or a stuck output.

    An input may have two levels only. An output that hardly ever changes is refused.

    Parameters
    ----------
    recording : Recording
        A recording that `check_recording` accepts.
    source : str
        The file that an error names.

    Raises
    ------
    InputError
        When a sample is one of `OVERFLOW_CODES`, or more than `LARGEST_STUCK_SHARE` of the output
        lies at one value or at its two limits.
    """
    for place, signal in recording.signals.items():
        found = np.isin(np.abs(signal), OVERFLOW_CODES)
        if found.any():
            first = int(np.argmax(found))
            raise InputError(
                source,
                f"the value is {signal[first]:g}, which instruments write for an overflow or a"
                " missing value",
                "repair the recording or cut that part away",
                f"{place}, sample {first + 1}",
            )
    output = recording.output
    values, counts = np.unique(output, return_counts=True)
    at_limits = np.count_nonzero((output == values[0]) | (output == values[-1])) / output.size
    usual = int(np.argmax(counts))
    for share, where in (
        (counts[usual] / output.size, f"are the same value, {values[usual]:g}"),
        (at_limits, f"lie at its smallest or largest value, {values[0]:g} or {values[-1]:g}"),
    ):
        if share > LARGEST_STUCK_SHARE:
            raise InputError(
                source,
                f"{100 * share:.1f} % of its samples {where}, so the channel was saturated, cut off"
                " or hardly ever changed",
                "record again within the range of the instrument, or cut that part away",
                f'output "{recording.output_name}"',
            )


def saturated_share(signal: NDArray[np.float64]) -> float:
    """Share of samples in runs of `MIN_SATURATED_RUN` or more at the smallest or largest value.

    0 for a signal of at most `MAX_DESIGNED_LEVELS` levels, and for one that is held for as long at
    most of its other values, such as random steps.
    """
    if np.unique(signal).size <= MAX_DESIGNED_LEVELS:
        return 0.0
    at_limit = (signal == signal.min()) | (signal == signal.max())
    starts = np.flatnonzero(np.diff(signal) != 0.0) + 1
    lengths = np.diff(np.concatenate(([0], starts, [signal.size])))
    stays = np.repeat(lengths >= MIN_SATURATED_RUN, lengths)
    if not at_limit.all() and stays[~at_limit].mean() > 0.5:
        return 0.0
    return float(np.mean(at_limit & stays))


def save_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording to an ``.npz`` file, atomically; equal recordings give equal bytes."""
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
    "stretch_starts",
    "stretch_recordings",
)


def recording_arrays(recording: Recording, prefix: str = "") -> dict[str, NDArray]:
    """The fields of a recording as arrays, each under its name after `prefix`."""
    return {prefix + field: np.asarray(getattr(recording, field)) for field in _FIELDS}


def recording_names(prefix: str = "") -> tuple[str, ...]:
    """The names of the arrays of `recording_arrays` with this prefix."""
    return tuple(prefix + field for field in _FIELDS)


def recording_from_arrays(arrays: dict[str, NDArray], prefix: str = "") -> Recording:
    """The recording whose fields `recording_arrays` gave as arrays."""
    values = {field: arrays[prefix + field] for field in _FIELDS}
    return Recording(
        input=values["input"],
        output=values["output"],
        sampling_rate=float(values["sampling_rate"]),
        **{name: str(values[name]) for name in _FIELDS[3:7]},
        stretch_starts=tuple(values["stretch_starts"].tolist()),
        stretch_recordings=tuple(values["stretch_recordings"].tolist()),
    )
