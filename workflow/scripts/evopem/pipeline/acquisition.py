"""Acquisition: a recording from files or simulated, in one fixed form."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from evopem.config.channels import ChannelSettings, Geometry, SyntheticSource
from evopem.config.settings import TransformSettings
from evopem.files.json_form import save
from evopem.results.layout import DatasetFiles
from evopem.signals.inspection import ChannelRoles, roles_of
from evopem.signals.reading import read_measured
from evopem.signals.recording import Recording, save_recording
from evopem.signals.recording_checks import joined
from evopem.signals.recording_info import RecordingInfo, check_measured_places, describe_recording
from evopem.synthesis import synthesize


def synthesize_recording(
    files: DatasetFiles, source: SyntheticSource, transforms: TransformSettings
) -> None:
    """Simulate a recording of a known system, non-stationary as the transforms undo it."""
    recording, truth = synthesize(source, transforms)
    save_recording(recording, files.recording)
    save(describe_recording(recording), files.recording_info)
    save(truth, files.truth)


def read_recording(
    files: DatasetFiles,
    recorded: tuple[str, ...],
    channels: ChannelSettings,
    channels_from_file: bool = False,
    validation: tuple[str, ...] = (),
    geometry: Geometry | None = None,
    folder: str | Path = "",
) -> None:
    """Read the input and output channels of a recorded file, or of several that are one data set.

    With ``channels_from_file`` input, output and time are those that the first file shows.
    ``validation``: files of recordings for validation, with the same channels.  The channels of a
    geometry must be outputs. Paths are relative to ``folder``, by default the working directory.
    """
    roles = roles_of(Path(folder) / recorded[0]) if channels_from_file else None
    recording, info = _read(recorded, channels, roles, folder)
    check_measured_places(geometry, recording.output_names, f"datasets.{files.name}.geometry")
    save_recording(recording, files.recording)
    save(info, files.recording_info)
    if validation:
        recording, info = _read(validation, channels, roles, folder)
        save_recording(recording, files.validation_recording)
        save(info, files.validation_recording_info)


def _read(
    recorded: Sequence[str],
    channels: ChannelSettings,
    roles: ChannelRoles | None,
    folder: str | Path,
) -> tuple[Recording, RecordingInfo]:
    if roles is not None:
        channels = replace(
            channels, inputs=(roles.input,), outputs=(roles.output,), time=roles.time
        )
    read = [read_measured(name, channels, folder) for name in recorded]
    recordings, origins = zip(*read, strict=True)
    recording = joined(recordings, recorded) if len(recordings) > 1 else recordings[0]
    return recording, describe_recording(recording, origins, roles)
