"""Acquisition: a recorded file or a simulated recording, in one fixed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from evopem.config.settings import ChannelSettings
from evopem.files.json_form import load, save
from evopem.signals.channel_roles import roles_of
from evopem.signals.inspection import may_tell_time, time_told
from evopem.signals.joining import joined
from evopem.signals.readers.channels import Reference
from evopem.signals.reading import read_measured
from evopem.signals.recording import save_recording
from evopem.signals.recording_info import RecordingInfo, describe_recorded_files


def read_recording(
    recorded: Sequence[str],
    channels: ChannelSettings,
    recording_file: str,
    info_file: str,
    folder: str | Path = "",
    told: bool = False,
    told_in: str = "",
) -> None:
    """Read the input and output channels of a recorded file, or of several that are one data set.

    Parameters
    ----------
    recorded : sequence of str
        The recorded files, as the settings name them.
    channels : ChannelSettings
    recording_file, info_file : str
        Where samples and origin are written.
    folder : path
        What relative paths are relative to; the working directory by default.
    told : bool
        Whether input, output and time are told from the first file, where it has a time.
    told_in : str
        The origin of another recording of the data set, whose channels these are; empty for none.

    Raises
    ------
    InputError
        When a file cannot be read, or the recordings are not of the same channels and rate.
    """
    roles = None
    if told and told_in:
        roles = load(RecordingInfo, told_in).roles
    elif told:
        roles = roles_of(Path(folder) / recorded[0])
    if roles is not None:
        channels = replace(channels, input=roles.input, output=roles.output, time=roles.time)
    paths = [Path(folder) / file for file in recorded]
    times = [_time_told(path, channels) for path in paths]
    read = [channels if time is None else replace(channels, time=time) for time in times]
    measured = [read_measured(*each) for each in zip(paths, read, strict=True)]
    recordings = [each.recording for each in measured]
    recording = joined(recordings, recorded) if len(recordings) > 1 else recordings[0]
    save_recording(recording, recording_file)
    info = describe_recorded_files(recorded, recording, channels, folder, roles)
    uneven = tuple(each.unevenness for each in measured if each.unevenness is not None)
    save(replace(info, time_told=times[0], uneven_times=uneven), info_file)


def _time_told(file: Path, channels: ChannelSettings) -> Reference | None:
    """The channel of time stamps where neither rate nor time nor the form of a table is stated."""
    if not may_tell_time(channels):
        return None
    signals = [channels.output] if channels.input is None else [channels.input, channels.output]
    return time_told(file, signals)
