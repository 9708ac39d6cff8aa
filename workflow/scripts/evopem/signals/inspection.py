"""What a measured file holds, before anything is known of it: channels, times and rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evopem.config.channels import ChannelSettings
from evopem.errors import InputError
from evopem.signals.measured_files import channel_names, read_channels
from evopem.signals.readers.channels import Channel, Reference
from evopem.signals.recording_checks import MOST_MISSING
from evopem.signals.time_units import names_time
from evopem.signals.timestamps import has_even_steps, timing

MOST_INCREASE = 0.95
"""Larger share of the steps of a time that do not decrease."""


@dataclass(frozen=True)
class SignalColumn:
    """A channel that may be an input or an output."""

    reference: Reference  # its name where that is unique in the file, else its number from 1
    unit: str  # as the file states it; empty when it does not
    samples: int
    sampling_rate: float | None  # Hz, where the file states one for this channel


@dataclass(frozen=True)
class TimeColumn:
    """A channel of uniform time stamps."""

    reference: Reference
    sampling_rate: float | None  # Hz; None where the unit of the stamps is not certain
    problem: str  # why the rate is not certain, in a sentence; empty where it is


@dataclass(frozen=True)
class FileContents:
    """What a measured file holds."""

    # channels of finite real numbers that are not constant, in the order of the file
    signals: tuple[SignalColumn, ...]
    time: TimeColumn | None  # the first channel of time stamps
    unread: str = ""  # why the first channel that cannot be read cannot; empty where all can


def inspect_file(path: str | Path) -> FileContents:
    """Read all channels of a measured file and tell times from signals.

    A time has even steps, or holds dates, or increases and is named as one. A channel that cannot
    be read, or holds text or a constant, is left out.
    """
    names = channel_names(path)
    signals: list[SignalColumn] = []
    time: TimeColumn | None = None
    unread = ""
    for number, name in enumerate(names, start=1):
        # A name with a * would be taken for a pattern, and "none" for no input.
        plain = name.isprintable() and "*" not in name and name not in ("", "none")
        reference = name if plain and names.count(name) == 1 else number
        try:
            (channel,) = read_channels(path, [number])
        except InputError as error:
            unread = unread or str(error)
            continue
        if _is_time(channel) or (time is None and _is_named_time(channel)):
            time = time or _time_column(channel, reference, str(path))
        elif _is_signal(channel):
            signals.append(
                SignalColumn(reference, channel.unit, channel.values.size, channel.sampling_rate)
            )
    return FileContents(tuple(signals), time, unread)


def may_tell_time(channels: ChannelSettings) -> bool:
    """Whether neither rate nor time nor the form of a text table is stated."""
    stated = (channels.sampling_rate, channels.time, channels.header_lines, channels.decimal_mark)
    return all(each is None for each in stated)


def time_told(path: str | Path, signals: Sequence[Reference]) -> Reference | None:
    """The channel of time stamps of a file that states no sampling rate; None where none is sure.

    It is none of the signals, is named as a time, and has uniform stamps of a known unit.
    """
    first = read_channels(path, signals[:1])[0]
    if first.sampling_rate is not None:
        return None
    names = channel_names(path)
    for number, name in enumerate(names, start=1):
        if not names_time(name) or {name, number}.intersection(signals):
            continue
        try:
            (channel,) = read_channels(path, [number])
        except InputError:
            continue
        reference = name if names.count(name) == 1 else number
        if channel.values.size != first.values.size:
            continue
        rate = _time_column(channel, reference, str(path)).sampling_rate
        if rate or _is_time(channel):
            return reference if rate else None
    return None


def _is_time(channel: Channel) -> bool:
    values = channel.values
    if values.dtype.kind in "Mm":
        return values.size > 1
    if values.dtype.kind not in "fiu" or values.size < 3:
        return False
    return has_even_steps(values.astype(np.float64))


def _is_named_time(channel: Channel) -> bool:
    """Whether a channel is named as a time and hardly ever decreases, as times that repeat do."""
    values = channel.values
    if values.dtype.kind not in "fiu" or values.size < 3 or not names_time(channel.name):
        return False
    steps = np.diff(values.astype(np.float64))
    return bool(values[-1] > values[0]) and float(np.mean(steps >= 0.0)) > MOST_INCREASE


def _time_column(channel: Channel, reference: Reference, source: str) -> TimeColumn:
    try:
        rate = timing(channel.values, source, channel.name, channel.unit).rate
    except InputError as error:
        return TimeColumn(reference, None, f"{error.problem}; {error.remedy}.")
    return TimeColumn(reference, rate, "")


def _is_signal(channel: Channel) -> bool:
    values = channel.values
    if values.dtype.kind not in "fiub" or values.size < 2:
        return False
    finite = values[np.isfinite(values)]
    return finite.size >= (1.0 - MOST_MISSING) * values.size and np.ptp(finite.astype(float)) > 0.0
