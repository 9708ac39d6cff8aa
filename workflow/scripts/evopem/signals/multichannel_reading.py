"""Read a recording of several channels from a measured file of any known format."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from evopem.config.state_space_settings import (
    ChannelLists,
    Geometry,
    Reference,
    UnitSettings,
    is_pattern,
)
from evopem.errors import InputError
from evopem.signals.even_grid import Unevenness
from evopem.signals.inspection import may_tell_time, time_told
from evopem.signals.measured_files import channel_names, format_of, local_path, sha256
from evopem.signals.multichannel import MultichannelRecording, check_multichannel
from evopem.signals.readers.channels import Channel, listing
from evopem.signals.reading import read_columns, refuse_time
from evopem.signals.recording import saturated_share


@dataclass(frozen=True)
class ChannelInfo:
    """What is known of a channel.

    Attributes
    ----------
    name, unit : str
    saturated_percent : float
        Percentage of samples that rest at the channel's smallest or largest value.
    """

    name: str
    unit: str
    saturated_percent: float


@dataclass(frozen=True)
class FileFacts:
    """The file that a recording was read from."""

    path: str
    sha256: str
    bytes: int
    format: str
    samples: int


@dataclass(frozen=True)
class MultichannelInfo:
    """Origin and properties of a recording of several channels.

    Attributes
    ----------
    samples : int
    sampling_rate : float
        Hz.
    inputs, outputs : tuple of ChannelInfo
    file : FileFacts
        The first file.
    further_files : tuple of FileFacts
        The others, where several recordings are one data set.
    time_told : int or str, optional
        The channel of time stamps of the first file, where it was told from the file.
    uneven_times : tuple of Unevenness
        Of the stamps of each file, where signals were brought to an even grid.
    """

    samples: int
    sampling_rate: float
    inputs: tuple[ChannelInfo, ...]
    outputs: tuple[ChannelInfo, ...]
    file: FileFacts
    further_files: tuple[FileFacts, ...] = ()
    time_told: int | str | None = None
    uneven_times: tuple[Unevenness, ...] = ()

    @property
    def files(self) -> tuple[FileFacts, ...]:
        """All files, in the order of the recordings."""
        return (self.file, *self.further_files)


class MeasuredChannels(NamedTuple):
    """A recording, and how uneven its time stamps were where it was brought to an even grid."""

    recording: MultichannelRecording
    unevenness: Unevenness | None


def read_multichannel(path: str | Path, channels: ChannelLists) -> MeasuredChannels:
    """Read the input and output channels of a measured file.

    A pattern stands for all channels whose names it matches and that no other entry names.

    Parameters
    ----------
    path : str or Path
    channels : ChannelLists

    Raises
    ------
    InputError
        As :func:`.read_recording`; when a pattern matches nothing; when a channel is named twice;
        when units do not fit the channels.
    """
    source = str(path)
    inputs, outputs = _expanded(path, channels)
    roles: dict[str, Reference] = {}
    roles |= {_role("input", inputs, number): each for number, each in enumerate(inputs, 1)}
    roles |= {_role("output", outputs, number): each for number, each in enumerate(outputs, 1)}
    found, rate, unevenness = read_columns(path, roles, channels)
    listed = list(found.values())
    names = _names([each.name for each in listed], len(inputs))
    of_inputs, of_outputs = listed[: len(inputs)], listed[len(inputs) :]
    recording = MultichannelRecording(
        inputs=np.column_stack([each.values for each in of_inputs])
        if of_inputs
        else np.empty((of_outputs[0].values.size, 0)),
        outputs=np.column_stack([each.values for each in of_outputs]),
        sampling_rate=rate,
        input_names=names[: len(inputs)],
        output_names=names[len(inputs) :],
        input_units=_units(
            channels.input_units, of_inputs, names[: len(inputs)], source, "input_unit"
        ),
        output_units=_units(
            channels.output_units, of_outputs, names[len(inputs) :], source, "output_unit"
        ),
    )
    check_multichannel(recording, source, measured=True)
    for role, each in found.items():
        refuse_time(each.values, rate, source, f'{role} "{each.name}"')
    return MeasuredChannels(recording, unevenness)


def with_time_told(path: str | Path, channels: ChannelLists) -> ChannelLists:
    """Add the channel of time stamps that the file tells, where neither it nor a rate is stated.

    Raises
    ------
    InputError
        As :func:`.time_told`, and where a pattern matches nothing.
    """
    if not may_tell_time(channels):
        return channels
    literal = [each for each in (*channels.inputs, *channels.outputs) if not is_pattern(each)]
    return replace(channels, time=time_told(path, literal or _expanded(path, channels)[1][-1:]))


def describe_multichannel(
    names: Sequence[str], recording: MultichannelRecording
) -> MultichannelInfo:
    """Origin and properties of a recording that was read from files, one for each record."""

    def described(signals: np.ndarray, names: Sequence[str], units: Sequence[str]):  # type: ignore[no-untyped-def]
        return tuple(
            ChannelInfo(name, unit, 100.0 * saturated_share(signal))
            for signal, name, unit in zip(signals.T, names, units, strict=True)
        )

    origins = [
        FileFacts(
            path=str(path),
            sha256=sha256(path),
            bytes=local_path(path).stat().st_size,
            format=format_of(path),
            samples=each.samples,
        )
        for path, each in zip(map(Path, names), recording.records, strict=True)
    ]
    return MultichannelInfo(
        samples=recording.samples,
        sampling_rate=recording.sampling_rate,
        inputs=described(recording.inputs, recording.input_names, recording.input_units),
        outputs=described(recording.outputs, recording.output_names, recording.output_units),
        file=origins[0],
        further_files=tuple(origins[1:]),
    )


def check_measured_places(geometry: Geometry | None, names: Iterable[str], place: str) -> None:
    """Refuse a geometry with a channel that is no output.

    Parameters
    ----------
    geometry : Geometry, optional
    names : iterable of str
        The outputs.
    place : str
        Configuration key of the geometry, for an error to name.

    Raises
    ------
    InputError
    """
    outputs = list(names)
    for channel in geometry.channels if geometry else ():
        if channel not in outputs:
            raise InputError(
                place,
                f'there is no output "{channel}"',
                f"choose one of {listing(outputs)}",
                f"channels.{channel}",
            )


def _expanded(
    path: str | Path, channels: ChannelLists
) -> tuple[tuple[Reference, ...], tuple[Reference, ...]]:
    """Inputs and outputs with every pattern replaced by the numbers of its channels."""
    written = {"input": channels.inputs, "output": channels.outputs}
    everything = [*channels.inputs, *channels.outputs]
    everything += [] if channels.time is None else [channels.time]
    if not any(map(is_pattern, everything)):
        return channels.inputs, channels.outputs
    names = channel_names(path)
    literal = [each for each in everything if not is_pattern(each)]
    named = {each for each in literal if isinstance(each, int)}
    named |= {number for number, name in enumerate(names, 1) if name in literal}
    taken: dict[int, str] = {}
    expanded: dict[str, list[Reference]] = {"input": [], "output": []}
    for role, references in written.items():
        for reference in references:
            if not is_pattern(reference):
                expanded[role].append(reference)
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
            expanded[role] += matching
    return tuple(expanded["input"]), tuple(expanded["output"])


def _matching(pattern: str, names: Sequence[str], named: Collection[int]) -> list[int]:
    """Numbers of the channels whose names fit a pattern, without those that are named."""
    fits = [number for number, name in enumerate(names, 1) if _matches(pattern, name)]
    return [number for number in fits if number not in named]


def _matches(pattern: str, name: str) -> bool:
    """Whether a name fits a pattern, in which only ``*`` has a meaning."""
    return re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), name, re.DOTALL) is not None


def _role(kind: str, references: Sequence[Reference], number: int) -> str:
    """What an error calls a channel: its role, with a number where there are several."""
    return kind if len(references) == 1 else f"{kind} {number}"


def _names(given: Sequence[str], inputs: int) -> tuple[str, ...]:
    """A name of its own for each channel; one without a name is called by its role."""
    names: list[str] = []
    for position, name in enumerate(given):
        number = position + 1 if position < inputs else position - inputs + 1
        fallback = f"{'input' if position < inputs else 'output'} {number}"
        chosen = name.strip() or fallback
        if chosen in names:
            chosen = f"{chosen} ({fallback})"
        names.append(chosen)
    return tuple(names)


def _units(
    given: UnitSettings,
    channels: Sequence[Channel],
    names: Sequence[str],
    source: str,
    key: str,
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
