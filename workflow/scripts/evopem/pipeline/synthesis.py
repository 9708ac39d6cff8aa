"""Synthesis: a simulated recording and the system behind it."""

from __future__ import annotations

from evopem.config.channels import SyntheticSource
from evopem.config.settings import TransformSettings
from evopem.files.json_form import save
from evopem.results.layout import DatasetFiles
from evopem.signals.recording import save_recording
from evopem.signals.recording_info import describe_recording
from evopem.synthesis import synthesize


def synthesize_recording(
    files: DatasetFiles, source: SyntheticSource, transforms: TransformSettings
) -> None:
    """Simulate a recording of a known system, non-stationary as the transforms undo it."""
    recording, truth = synthesize(source, transforms)
    save_recording(recording, files.recording)
    save(describe_recording(recording), files.recording_info)
    save(truth, files.truth)
