"""Origin and properties of a recording, as they are kept beside its samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from evopem.config.settings import ChannelSettings
from evopem.signals.channel_roles import ChannelRoles
from evopem.signals.even_grid import Unevenness
from evopem.signals.measured_files import format_of, local_path, sha256
from evopem.signals.recording import Recording, saturated_share


@dataclass(frozen=True)
class FileOrigin:
    """The file that a recording was read from.

    Attributes
    ----------
    path, sha256 : str
    bytes : int
        Size of the file.
    format : str
    input_channel, output_channel : int or str
        The channels as they were asked for; None for no input.
    samples : int
    """

    path: str
    sha256: str
    bytes: int
    format: str
    input_channel: int | str | None
    output_channel: int | str
    samples: int


@dataclass(frozen=True)
class RecordingInfo:
    """Origin and properties of a recording.

    Attributes
    ----------
    kind : {"file", "synthesis"}
    samples : int
    sampling_rate : float
        Hz.
    input_name, output_name, input_unit, output_unit : str
    input_saturated_percent, output_saturated_percent : float
        Percentage of samples that rest at the channel's smallest or largest value.
    file : FileOrigin, optional
        The first file; None for a synthetic recording.
    further_files : tuple of FileOrigin
        The others, where several recordings are one data set.
    roles : ChannelRoles, optional
        Where input, output and time were told from the first file.
    time_told : int or str, optional
        The channel of time stamps of the first file, where it alone was told from the file.
    uneven_times : tuple of Unevenness
        Of the stamps of each file, where signals were brought to an even grid, or the clock is
        coarse.
    """

    kind: Literal["file", "synthesis"]
    samples: int
    sampling_rate: float
    input_name: str
    output_name: str
    input_unit: str
    output_unit: str
    input_saturated_percent: float
    output_saturated_percent: float
    file: FileOrigin | None = None
    further_files: tuple[FileOrigin, ...] = ()
    roles: ChannelRoles | None = None
    time_told: int | str | None = None
    uneven_times: tuple[Unevenness, ...] = ()

    @property
    def files(self) -> tuple[FileOrigin, ...]:
        """All files, in the order of the recordings; none for a synthetic recording."""
        return (self.file, *self.further_files) if self.file else ()


def describe_synthetic_recording(recording: Recording) -> RecordingInfo:
    """Properties of a simulated recording."""
    return _info(recording, "synthesis", [])


def describe_recorded_files(
    names: Sequence[str | Path],
    recording: Recording,
    channels: ChannelSettings,
    folder: str | Path = "",
    roles: ChannelRoles | None = None,
) -> RecordingInfo:
    """Origin and properties of a recording that was read from files, one for each stretch.

    Parameters
    ----------
    names : sequence of path
        What the settings call the files.
    recording : Recording
    channels : ChannelSettings
    folder : path
        What relative names are relative to; the working directory by default.
    roles : ChannelRoles, optional
        Where the channels were told from the first file.
    """
    origins = [
        FileOrigin(
            path=str(path),
            sha256=sha256(Path(folder) / path),
            bytes=local_path(Path(folder) / path).stat().st_size,
            format=format_of(path),
            input_channel=channels.input,
            output_channel=channels.output,
            samples=stretch.samples,
        )
        for path, stretch in zip(map(Path, names), recording.stretches, strict=True)
    ]
    return replace(_info(recording, "file", origins), roles=roles)


def _info(
    recording: Recording, kind: Literal["file", "synthesis"], origins: Sequence[FileOrigin]
) -> RecordingInfo:
    return RecordingInfo(
        kind=kind,
        samples=recording.samples,
        sampling_rate=recording.sampling_rate,
        input_name=recording.input_name,
        output_name=recording.output_name,
        input_unit=recording.input_unit,
        output_unit=recording.output_unit,
        input_saturated_percent=100.0 * saturated_share(recording.input),
        output_saturated_percent=100.0 * saturated_share(recording.output),
        file=origins[0] if origins else None,
        further_files=tuple(origins[1:]),
    )
