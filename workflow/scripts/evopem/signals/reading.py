"""Read a recording from a measured file of any known format."""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.config.channels import ChannelSettings, UnitSettings, is_pattern
from evopem.errors import InputError
from evopem.signals.even_grid import Unevenness
from evopem.signals.inspection import may_tell_time, time_told
from evopem.signals.measured_files import channel_names, read_channels
from evopem.signals.readers.channels import Channel, Reference, listing
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import check_measured, check_recording
from evopem.signals.sampling import sampled
from evopem.signals.timestamps import is_time

Array = NDArray[np.float64]


class MeasuredRecording(NamedTuple):
    """A recording, and how uneven its time stamps were where it was brought to an even grid."""

    recording: Recording
    unevenness: Unevenness | None


def read_measured(path: str | Path, channels: ChannelSettings) -> MeasuredRecording:
    """Read the input and output channels of a measured file, by the settings of a data set.

    Raises
    ------
    InputError
        When the file cannot be read as its format; a channel is not there or not a signal
        of finite numbers; inputs, outputs and time are not different signals; the sampling rate is
        unknown or contradicted by the time stamps; or units do not fit the channels.
    """
    source = str(Path(path))
    rate = channels.sampling_rate
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise InputError(
            source, f"{rate} Hz is not a sampling rate", "give a positive number of Hz"
        )
    inputs, outputs = _expanded(path, channels)
    references = {
        kind if len(listed) == 1 else f"{kind} {number}": each
        for kind, listed in (("input", inputs), ("output", outputs))
        for number, each in enumerate(listed, 1)
    }
    roles = list(references)
    _refuse_same_reference(references, source)
    if channels.time is not None:
        references["time"] = channels.time
    read = read_channels(
        path, list(references.values()), channels.header_lines, channels.decimal_mark
    )
    found = dict(zip(references, read, strict=True))
    values = {role: _signal(found[role], role, source) for role in roles}
    first = roles[0]
    for role, each in values.items():
        if each.size != values[first].size:
            raise InputError(
                source,
                f"the {first} has {values[first].size} samples and the {role} {each.size}",
                f"choose {'two ' * (len(values) == 2)}channels that were sampled together",
            )
    _refuse_same(found, references, source)
    values, rate, unevenness = sampled(values, found, channels, source)
    for role in roles:
        _refuse_other_start([found[first], found[role]], rate, source)
    read = read[: len(roles)]  # without the time
    names = _names(read, roles)
    signals = np.column_stack([values[role] for role in roles])
    count = len(inputs)
    recording = Recording(
        *(signals[:, :count], signals[:, count:], rate, names[:count], names[count:]),
        _units(channels.input_units, read[:count], names[:count], source, "input_unit"),
        _units(channels.output_units, read[count:], names[count:], source, "output_unit"),
    )
    check_recording(recording, source)
    check_measured(recording, source)
    for place, signal in recording.signals.items():
        if is_time(signal, rate):
            raise InputError(
                source,
                "the channel increases by the sampling period in every sample, as a time does",
                "choose another channel",
                place,
            )
    return MeasuredRecording(recording, unevenness)


def with_time_told(path: str | Path, channels: ChannelSettings) -> ChannelSettings:
    """Add the channel of time stamps that the file tells, where neither it nor a rate is stated."""
    if not may_tell_time(channels):
        return channels
    inputs, outputs = _expanded(path, channels)
    return replace(channels, time=time_told(path, [*inputs, *outputs]))


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


def _expanded(
    path: str | Path, channels: ChannelSettings
) -> tuple[tuple[Reference, ...], tuple[Reference, ...]]:
    """Inputs and outputs with every pattern replaced by the numbers of its channels.

    A pattern stands for all channels whose names it matches and that no other entry names.  The
    very name of a channel is no pattern, whatever it holds.
    """
    written = {"input": channels.inputs, "output": channels.outputs}
    everything = [*channels.inputs, *channels.outputs]
    everything += [] if channels.time is None else [channels.time]
    if not any(map(is_pattern, everything)):
        return channels.inputs, channels.outputs
    names = channel_names(path)
    known = {*names, *(name.rpartition("/")[2] for name in names)}
    literal = [each for each in everything if not is_pattern(each) or each in known]
    named = {each for each in literal if isinstance(each, int)}
    named |= {number for number, name in enumerate(names, 1) if name in literal}
    taken: dict[int, str] = {}
    chosen: dict[str, list[Reference]] = {"input": [], "output": []}
    for role, references in written.items():
        for reference in references:
            if reference in literal:
                chosen[role].append(reference)
                continue
            # A channel of a group is found by its own name as well, as one without a pattern is.
            matching = _matching(str(reference), names, named) or _matching(
                str(reference), [name.rpartition("/")[2] for name in names], named
            )
            if not matching:
                raise InputError(
                    str(path),
                    f'no channel matches "{reference}"',
                    f"choose among {listing(names)}" if any(names) else "give numbers",
                    role,
                )
            for number in matching:
                if number in taken:
                    raise InputError(
                        str(path),
                        f'the channel "{names[number - 1]}" matches "{reference}" and'
                        f" {taken[number]}",
                        "give patterns that share no channel",
                        role,
                    )
                taken[number] = f'"{reference}" of {role}'
            chosen[role] += matching
    return tuple(chosen["input"]), tuple(chosen["output"])


def _matching(pattern: str, names: Sequence[str], named: Collection[int]) -> list[int]:
    """Numbers of the channels whose names fit a pattern, without those that are named."""
    fits = [number for number, name in enumerate(names, 1) if _matches(pattern, name)]
    return [number for number in fits if number not in named]


def _matches(pattern: str, name: str) -> bool:
    """Whether a name fits a pattern, in which only ``*`` has a meaning."""
    return re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), name, re.DOTALL) is not None
