"""The record of all decisions about several channels."""

from __future__ import annotations

from evopem.automatic.delays import DelayChoice
from evopem.automatic.preparation import PreparationPlan
from evopem.automatic.record import OtherModel
from evopem.automatic.state_space_choice import StateSpaceChoice
from evopem.automatic.state_space_remedies import RemedyRecord
from evopem.files.json_form import load, save
from evopem.results.layout import DatasetFiles
from evopem.results.multichannel import DecisionList


def collect_state_space_decisions(files: DatasetFiles) -> None:
    """Put all decisions of a data set into one file."""
    preparation = load(PreparationPlan, files.decision("preparation"))
    delays = load(DelayChoice, files.decision("delay"))
    choice = load(StateSpaceChoice, files.decision("comparison"))
    decisions = (*preparation.decisions, delays.decision, *choice.decisions)
    other = None
    if choice.other is not None:
        other = load(OtherModel, files.other_errors(choice.other.purpose))
    remedies = load(RemedyRecord, files.decision("remedies"))
    save(DecisionList(choice.model.purpose, decisions, remedies, other), files.decisions)
