"""Summary: the model, modes, errors and checks of one data set in one small file."""

from __future__ import annotations

from evopem.automatic.candidates import StructureSearch
from evopem.automatic.remedies import Remedied
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load, save
from evopem.results.dataset import searched_range
from evopem.results.fleet import summarize
from evopem.results.layout import DatasetFiles
from evopem.signals.recording_info import RecordingInfo
from evopem.validation.checks import Evidence
from evopem.validation.checks.search import ranges_of_phases
from evopem.validation.validation import Validation


def summarize_dataset(files: DatasetFiles, phases: tuple[str, ...], is_automatic: bool) -> None:
    """Check the model of one data set, and write the summary.

    ``phases``: of the order search; none for several channels.  ``is_automatic``: whether the
    automatic recipe has chosen the model.
    """
    record = load(ModelRecord, files.model)
    ranges = ranges_of_phases({phase: load(PhaseSelection, files.phase(phase)) for phase in phases})
    if not phases:
        chosen = load(Remedied, files.decision("remedies")).choice.candidate
        search = load(StructureSearch, files.search(chosen.structure))
        ranges = searched_range(record, chosen.order, search)
    evidence = Evidence(
        record,
        load(Validation, files.validation),
        load(RecordingInfo, files.recording_info),
        ranges,
        is_automatic,
    )
    save(summarize(evidence, (files.recording_info, files.model, files.validation)), files.summary)
