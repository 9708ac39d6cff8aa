"""Origin and properties of a recording, as they are kept beside its samples."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from evopem.config.channels import Geometry
from evopem.errors import InputError
from evopem.signals.inspection import ChannelRoles
from evopem.signals.readers.open_file import Reference, listing
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
    mean: float = math.nan  # of the samples as recorded
    standard_deviation: float = math.nan


@dataclass(frozen=True)
class FileOrigin:
    """The file that a recording was read from, and what was done to its samples."""

    path: str
    sha256: str
    bytes: int  # size of the file
    format: str
    inputs: tuple[Reference, ...]  # the channels as they were asked for
    outputs: tuple[Reference, ...]
    samples: int  # that are used
    segments: int = 1  # stretches of consecutive samples
    left_out: int = 0  # samples that are missing, and those of short stretches between such
    filled: int = 0  # values of samples that were missing and are interpolated
    time_from_file: Reference | None = None  # the channel of time stamps, recognised in the file
    # of the stamps, where the signals were brought to an even grid, or the clock is coarse
    unevenness: Unevenness | None = None


@dataclass(frozen=True)
class RecordingInfo:
    """Origin and properties of a recording."""

    samples: int
    sampling_rate: float  # Hz
    inputs: tuple[ChannelInfo, ...]
    outputs: tuple[ChannelInfo, ...]
    # one for each recording, in their order; none for a synthetic recording
    files: tuple[FileOrigin, ...] = ()
    roles: ChannelRoles | None = None  # where input, output and time were found in the first file


def describe_recording(
    recording: Recording, files: tuple[FileOrigin, ...] = (), roles: ChannelRoles | None = None
) -> RecordingInfo:
    """Properties of a recording, simulated where it has no files."""

    def described(role: str) -> tuple[ChannelInfo, ...]:
        names, units = getattr(recording, f"{role}_names"), getattr(recording, f"{role}_units")
        rows = zip(names, units, getattr(recording, f"{role}s").T, strict=True)
        share = partial(saturated_share, is_input=role == "input")
        return tuple(
            ChannelInfo(name, unit, 100.0 * share(x), float(np.mean(x)), float(np.std(x)))
            for name, unit, x in rows
        )

    channels = described("input"), described("output")
    return RecordingInfo(recording.samples, recording.sampling_rate, *channels, files, roles)


def check_measured_places(geometry: Geometry | None, names: Iterable[str], place: str) -> None:
    """Refuse a geometry with a channel that is no output."""
    outputs = list(names)
    for channel in geometry.channels if geometry else ():
        if channel not in outputs:
            problem = f'there is no output "{channel}"'
            remedy = f"choose one of {listing(outputs)}"
            raise InputError(place, problem, remedy, f"channels.{channel}")
