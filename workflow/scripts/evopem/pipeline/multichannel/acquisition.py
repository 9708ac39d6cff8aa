"""The configuration of a data set with several channels, and the reading of its recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from evopem.config.state_space_keys import state_space_yaml
from evopem.config.state_space_settings import ChannelLists, Geometry, MultichannelDataset
from evopem.files.atomic import write_text
from evopem.files.checksums import delete_results
from evopem.files.json_form import save
from evopem.results.layout import DatasetFiles
from evopem.signals.joining import joined_multichannel
from evopem.signals.multichannel import save_multichannel
from evopem.signals.multichannel_reading import (
    check_measured_places,
    describe_multichannel,
    read_multichannel,
    with_time_told,
)


def write_multichannel_configuration(files: DatasetFiles, settings: MultichannelDataset) -> None:
    """Keep the complete configuration of a data set beside its results."""
    delete_results(files.folder, {Path(files.details).name})  # its contents are written anew
    write_text(files.config, state_space_yaml(settings))


def read_channels(
    recorded: Sequence[str],
    channels: ChannelLists,
    geometry: Geometry | None,
    place: str,
    recording_file: str,
    info_file: str,
) -> None:
    """Read the input and output channels of a recorded file, or of several that are one data set.

    Parameters
    ----------
    recorded : sequence of str
        The recorded files.
    channels : ChannelLists
    geometry : Geometry, optional
        Its channels must be outputs.
    place : str
        Configuration key of the data set, for an error to name.
    recording_file, info_file : str
        Where samples and origin are written.

    Raises
    ------
    InputError
        When a file cannot be read, or the recordings are not of the same channels and rate.
    """
    told = [with_time_told(file, channels) for file in recorded]
    measured = [read_multichannel(*each) for each in zip(recorded, told, strict=True)]
    recordings = [each.recording for each in measured]
    recording = joined_multichannel(recordings, recorded) if len(recordings) > 1 else recordings[0]
    check_measured_places(geometry, recording.output_names, f"{place}.geometry")
    save_multichannel(recording, recording_file)
    info = replace(
        describe_multichannel(recorded, recording),
        time_told=None if told[0] == channels else told[0].time,
        uneven_times=tuple(each.unevenness for each in measured if each.unevenness is not None),
    )
    save(info, info_file)
