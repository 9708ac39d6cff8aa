"""Origin and properties of a recording, as they are kept beside its samples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from evopem.config.channels import Geometry
from evopem.errors import InputError
from evopem.files.checksums import sha256_of_file
from evopem.signals.inspection import ChannelRoles
from evopem.signals.measured_files import format_of, local_path
from evopem.signals.readers.channels import Reference, listing
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import saturated_share
from evopem.signals.timestamps import Unevenness


@dataclass(frozen=True)
class ChannelInfo:
    """What is known of a channel."""

    name: str
    unit: str
    # percentage of samples that rest at the channel's smallest or largest value
    saturated_percent: float


@dataclass(frozen=True)
class FileOrigin:
    """The file that a recording was read from."""

    path: str
    sha256: str
    bytes: int  # size of the file
    format: str
    inputs: tuple[Reference, ...]  # the channels as they were asked for
    outputs: tuple[Reference, ...]
    samples: int  # that are used
    segments: int = 1  # stretches of consecutive samples
    left_out: int = 0  # samples that are missing, and those of short stretches between such


@dataclass(frozen=True)
class RecordingInfo:
    """Origin and properties of a recording."""

    kind: Literal["file", "synthesis"]
    samples: int
    sampling_rate: float  # Hz
    inputs: tuple[ChannelInfo, ...]
    outputs: tuple[ChannelInfo, ...]
    # one for each recording, in their order; none for a synthetic recording
    files: tuple[FileOrigin, ...] = ()
    roles: ChannelRoles | None = None  # where input, output and time were told from the first file
    # the channel of time stamps of the first file, where it alone was told from the file
    time_told: Reference | None = None
    # of the stamps of each file, where signals were brought to an even grid, or the clock is coarse
    uneven_times: tuple[Unevenness, ...] = ()


def describe_recording(
    recording: Recording,
    files: Sequence[FileOrigin] = (),
    roles: ChannelRoles | None = None,
    time_told: Reference | None = None,
    uneven_times: tuple[Unevenness, ...] = (),
) -> RecordingInfo:
    """Properties of a recording, simulated where it has no files."""

    def described(role: str) -> tuple[ChannelInfo, ...]:
        names, units = getattr(recording, f"{role}_names"), getattr(recording, f"{role}_units")
        found = zip(names, units, getattr(recording, f"{role}s").T, strict=True)
        return tuple(ChannelInfo(name, unit, 100.0 * saturated_share(x)) for name, unit, x in found)

    kind: Literal["file", "synthesis"] = "file" if files else "synthesis"
    return RecordingInfo(
        *(kind, recording.samples, recording.sampling_rate),
        inputs=described("input"),
        outputs=described("output"),
        files=tuple(files),
        roles=roles,
        time_told=time_told,
        uneven_times=uneven_times,
    )


def describe_file(
    name: str | Path,
    recording: Recording,
    left_out: int,
    inputs: tuple[Reference, ...],
    outputs: tuple[Reference, ...],
    folder: str | Path = "",
) -> FileOrigin:
    """Origin of a recording that was read from a file.

    ``name`` is what the settings call the file, relative to ``folder``; ``inputs`` and ``outputs``
    are the channels as they were asked for.
    """
    path = Path(folder) / name
    local = local_path(path)
    return FileOrigin(
        *(str(Path(name)), sha256_of_file(local), local.stat().st_size, format_of(path)),
        *(inputs, outputs),
        *(recording.samples, len(recording.segments), left_out),
    )


def check_measured_places(geometry: Geometry | None, names: Iterable[str], place: str) -> None:
    """Refuse a geometry with a channel that is no output."""
    outputs = list(names)
    for channel in geometry.channels if geometry else ():
        if channel not in outputs:
            problem = f'there is no output "{channel}"'
            remedy = f"choose one of {listing(outputs)}"
            raise InputError(place, problem, remedy, f"channels.{channel}")
