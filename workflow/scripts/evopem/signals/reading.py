"""Read a recording from a measured file of any known format."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import ChannelSettings, UnevenTime, UnitSettings
from evopem.errors import InputError
from evopem.signals.channel_patterns import expanded
from evopem.signals.even_grid import Unevenness
from evopem.signals.inspection import may_tell_time, time_told
from evopem.signals.measured_files import read_channels
from evopem.signals.readers.channels import Channel, Reference, listing
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import check_measured, check_recording
from evopem.signals.sampling import sampled
from evopem.signals.timestamps import is_time

Array = NDArray[np.float64]


def read_recording(
    path: str | Path,
    input: Reference | Sequence[Reference] | None,  # noqa: A002
    output: Reference | Sequence[Reference],
    sampling_rate: float | None = None,
    time: Reference | None = None,
    input_unit: str = "",
    output_unit: str = "",
    time_unit: str | None = None,
    header_lines: int | None = None,
    decimal_mark: Literal[".", ","] | None = None,
    uneven_time: UnevenTime = "refuse",
) -> Recording:
    """Read input and output channels of a measured file.

    `path`: A file of one of `FORMATS`; the extension decides. `input`, `output`: The channels: a
    number counted from 1, or a column, variable or channel name, in which a ``*`` stands for all
    that match.  Without an input, None. `sampling_rate`: Hz. Left out, it is taken from `time`,
    else from the file where its format states one. `time`: Channel of time stamps, which must be
    uniform (see `sampling_rate_of`). `input_unit`, `output_unit`: Units; left out, those that the
    file states. `time_unit`: Unit of the time stamps, one of `TIME_UNITS`; left out, the one that
    the file states. `header_lines`: Of a text table, the number of lines above the first row of
    numbers. `decimal_mark`: Of a text table, "." or ",". `uneven_time`: What is done with time
    stamps that are not uniform: signals may be brought to an even grid (:func:`.even_grid`).
    """
    lists = ChannelSettings(
        inputs=() if input is None else _listed(input),
        outputs=_listed(output),
        sampling_rate=sampling_rate,
        time=time,
        time_unit=time_unit,
        input_units=UnitSettings(input_unit),
        output_units=UnitSettings(output_unit),
        header_lines=header_lines,
        decimal_mark=decimal_mark,
        uneven_time=uneven_time,
    )
    return read_measured(path, lists).recording


def _listed(references: Reference | Sequence[Reference]) -> tuple[Reference, ...]:
    return (references,) if isinstance(references, int | str) else tuple(references)


class MeasuredRecording(NamedTuple):
    """A recording, and how uneven its time stamps were where it was brought to an even grid."""

    recording: Recording
    unevenness: Unevenness | None


def read_measured(path: str | Path, channels: ChannelSettings) -> MeasuredRecording:
    """The same by the settings of a data set."""
    source = str(Path(path))
    _check_rate(channels.sampling_rate, source)
    inputs, outputs = expanded(path, channels)
    roles = {_role("input", inputs, number): each for number, each in enumerate(inputs, 1)}
    roles |= {_role("output", outputs, number): each for number, each in enumerate(outputs, 1)}
    _refuse_same_reference(roles, source)
    columns = read_columns(path, roles, channels)
    found = list(columns.channels.values())
    parts = found[: len(inputs)], found[len(inputs) :]
    names = _names(found, list(roles))
    of_parts = names[: len(inputs)], names[len(inputs) :]
    no_samples = np.empty((found[0].values.size, 0))
    recording = Recording(
        np.column_stack([no_samples, *(each.values for each in parts[0])]),
        np.column_stack([each.values for each in parts[1]]),
        columns.sampling_rate,
        *of_parts,
        _units(channels.input_units, parts[0], of_parts[0], source, "input_unit"),
        _units(channels.output_units, parts[1], of_parts[1], source, "output_unit"),
    )
    check_recording(recording, source)
    check_measured(recording, source)
    for place, signal in recording.signals.items():
        _refuse_time(signal, columns.sampling_rate, source, place)
    return MeasuredRecording(recording, columns.unevenness)


def with_time_told(path: str | Path, channels: ChannelSettings) -> ChannelSettings:
    """Add the channel of time stamps that the file tells, where neither it nor a rate is stated."""
    if not may_tell_time(channels):
        return channels
    inputs, outputs = expanded(path, channels)
    return replace(channels, time=time_told(path, [*inputs, *outputs]))


class Columns(NamedTuple):
    """Channels of a file that were sampled together."""

    channels: dict[str, Channel]  # by role, without the time stamps; values are float64
    sampling_rate: float  # Hz
    # of the time stamps, where the channels were brought to an even grid
    unevenness: Unevenness | None


def read_columns(
    path: str | Path, roles: Mapping[str, Reference], stated: ChannelSettings
) -> Columns:
    """Read any number of channels that were sampled together, with their sampling rate.

    `roles`: Channels by what an error calls them, such as ``output 2``. `stated`: Of these the
    rate, the time stamps and the form of a text table.
    """
    path = Path(path)
    source = str(path)
    references = dict(roles) if stated.time is None else {**roles, "time": stated.time}
    found = read_channels(path, list(references.values()), stated.header_lines, stated.decimal_mark)
    channels = dict(zip(references, found, strict=True))
    values = {role: _signal(channels[role], role, source) for role in roles}
    first = next(iter(values))
    for role, each in values.items():
        if each.size != values[first].size:
            raise InputError(
                source,
                f"the {first} has {values[first].size} samples and the {role} {each.size}",
                f"choose {'two ' * (len(values) == 2)}channels that were sampled together",
            )
    _refuse_same(channels, references, source)
    signals, rate, unevenness = sampled(
        *(values, channels, stated.sampling_rate, stated.time_unit, stated.uneven_time, source)
    )
    for role in roles:
        _refuse_other_start([channels[first], channels[role]], rate, source)
    on_grid = {role: replace(channels[role], values=signals[role]) for role in roles}
    return Columns(on_grid, rate, unevenness)


def _refuse_time(values: Array, rate: float, source: str, place: str) -> None:
    """Refuse a signal that is a time."""
    if is_time(values, rate):
        raise InputError(
            source,
            "the channel increases by the sampling period in every sample, as a time does",
            "choose another channel",
            place,
        )


def _check_rate(rate: float | None, source: str) -> None:
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise InputError(
            source, f"{rate} Hz is not a sampling rate", "give a positive number of Hz"
        )


def _refuse_same_reference(roles: Mapping[str, Reference], source: str) -> None:
    for (first, reference), (second, other) in itertools.combinations(roles.items(), 2):
        if reference == other:
            raise InputError(
                source,
                f"channel {reference!r} is named as the {first} and as the {second}",
                "choose two different channels",
            )


def _signal(channel: Channel, role: str, source: str) -> Array:
    """The samples of an input or output channel as real numbers."""
    if channel.values.dtype.kind not in "fiub":
        kinds = {"c": "complex numbers", "M": "dates"}
        raise InputError(
            source,
            f"the channel holds {kinds.get(channel.values.dtype.kind, 'text or objects')},"
            " not real numbers",
            "choose another channel",
            f'{role} "{channel.name}"' if channel.name else role,
        )
    return channel.values.astype(np.float64)


def _refuse_same(
    channels: dict[str, Channel], references: dict[str, Reference], source: str
) -> None:
    """Refuse an input, an output and a time of which two hold the same values."""
    for one, other in itertools.combinations(channels, 2):
        first, second = channels[one].values, channels[other].values
        if np.array_equal(first, second):
            raise InputError(
                source,
                f"the {one} ({references[one]!r}) and the {other}"
                f" ({references[other]!r}) hold the same values",
                "choose different channels",
            )


def _refuse_other_start(channels: list[Channel], rate: float, source: str) -> None:
    """Refuse an input and an output that begin at different times."""
    starts = [channel.start for channel in channels if channel.start is not None]
    # A date in seconds since 1970 has a resolution of less than a microsecond as a float.
    if len(starts) == 2 and abs(starts[1] - starts[0]) > max(0.5 / rate, 1e-6):
        raise InputError(
            source,
            f"the output begins {starts[1] - starts[0]:g} s after the input",
            "choose two channels that were sampled together",
        )


def _role(kind: str, references: Sequence[Reference], number: int) -> str:
    """What an error calls a channel: its role, with a number where there are several."""
    return kind if len(references) == 1 else f"{kind} {number}"


def _names(given: Sequence[Channel], roles: Sequence[str]) -> tuple[str, ...]:
    """A name of its own for each channel; one without a name is called by its role."""
    names: list[str] = []
    for channel, role in zip(given, roles, strict=True):
        chosen = channel.name.strip() or role
        names.append(f"{chosen} ({role})" if chosen in names else chosen)
    return tuple(names)


def _units(
    given: UnitSettings, channels: Sequence[Channel], names: Sequence[str], source: str, key: str
) -> tuple[str, ...]:
    """The unit of each channel: the stated one, else the file's own."""
    if given.in_order and len(given.in_order) != len(channels):
        raise InputError(
            source,
            f"there are {len(given.in_order)} units and {len(channels)} channels",
            "give one unit for each, one for all, or a mapping by their names",
            key,
        )
    unknown = next((name for name in given.by_name if name not in names), None)
    if unknown is not None:
        raise InputError(
            source, f'there is no channel "{unknown}"', f"choose one of {listing(names)}", key
        )
    stated = given.in_order or (given.all,) * len(channels)
    return tuple(
        given.by_name.get(name) or unit or channel.unit
        for name, unit, channel in zip(names, stated, channels, strict=True)
    )
