"""Origin and properties of a recording, as they are kept beside its samples."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from evopem.config.settings import ChannelSettings
from evopem.signals.reading import format_of, local_path, sha256
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
    """

    path: str
    sha256: str
    bytes: int
    format: str
    input_channel: int | str | None
    output_channel: int | str


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
        None for a synthetic recording.
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


def describe_synthetic_recording(recording: Recording) -> RecordingInfo:
    """Properties of a simulated recording."""
    return _info(recording, "synthesis", None)


def describe_recorded_file(
    path: str | Path, recording: Recording, channels: ChannelSettings, name: str = ""
) -> RecordingInfo:
    """Origin and properties of a recording that was read from a file.

    Parameters
    ----------
    path : path
    recording : Recording
    channels : ChannelSettings
    name : str
        What the settings call the file; empty for its path.
    """
    path = Path(path)
    origin = FileOrigin(
        path=name or str(path),
        sha256=sha256(path),
        bytes=local_path(path).stat().st_size,
        format=format_of(path),
        input_channel=channels.input,
        output_channel=channels.output,
    )
    return _info(recording, "file", origin)


def _info(
    recording: Recording, kind: Literal["file", "synthesis"], origin: FileOrigin | None
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
        file=origin,
    )
