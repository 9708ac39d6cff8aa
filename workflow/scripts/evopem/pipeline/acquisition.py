"""Acquisition: a recorded file or a simulated recording, in one fixed form."""

from __future__ import annotations

from pathlib import Path

from evopem.config.settings import ChannelSettings
from evopem.files.json_form import save
from evopem.signals.reading import read_recording as read_channels
from evopem.signals.recording import save_recording
from evopem.signals.recording_info import describe_recorded_file


def read_recording(
    file: str,
    channels: ChannelSettings,
    recording_file: str,
    info_file: str,
    folder: str | Path = "",
) -> None:
    """Read the input and output channels of a recorded file.

    Parameters
    ----------
    file : str
        The recorded file, as the settings name it.
    channels : ChannelSettings
    recording_file, info_file : str
        Where samples and origin are written.
    folder : path
        What a relative `file` is relative to; the working directory by default.
    """
    path = Path(folder) / file
    recording = read_channels(
        path,
        input=channels.input,
        output=channels.output,
        sampling_rate=channels.sampling_rate,
        time=channels.time,
        input_unit=channels.input_unit,
        output_unit=channels.output_unit,
        time_unit=channels.time_unit,
        header_lines=channels.header_lines,
        decimal_mark=channels.decimal_mark,
    )
    save_recording(recording, recording_file)
    save(describe_recorded_file(path, recording, channels, file), info_file)
