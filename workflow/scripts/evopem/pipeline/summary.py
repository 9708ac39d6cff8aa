"""Summary: the orders, modes, errors and checks of one data set in one small file."""

from __future__ import annotations

from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load, save
from evopem.results.fleet import summarize
from evopem.results.layout import DatasetFiles
from evopem.signals.recording_info import RecordingInfo
from evopem.signals.spectral.summary import SpectrumSummary
from evopem.validation.validation import Validation


def summarize_dataset(files: DatasetFiles, phases: tuple[str, ...]) -> None:
    """Check the model of one data set, and write the summary."""
    summary = summarize(
        load(ModelRecord, files.model),
        load(Validation, files.validation),
        load(SpectrumSummary, files.spectrum_summary),
        {phase: load(PhaseSelection, files.phase(phase)) for phase in phases},
        load(RecordingInfo, files.recording_info),
        made_from=(files.recording_info, files.model, files.validation),
    )
    save(summary, files.summary)
