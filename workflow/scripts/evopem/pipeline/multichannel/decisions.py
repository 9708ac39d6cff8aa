"""The record of all decisions about several channels."""

from __future__ import annotations

from evopem.automatic.candidates import StructureSearch
from evopem.automatic.delays import DelayChoice
from evopem.automatic.folds import FoldPlan
from evopem.automatic.preparation import PreparationPlan
from evopem.automatic.record import DecisionRecord, OtherModel
from evopem.automatic.remedies import Remedied
from evopem.automatic.structures import Comparison
from evopem.files.json_form import load, save
from evopem.results.layout import DatasetFiles


def collect_state_space_decisions(
    files: DatasetFiles, structures: tuple[str, ...], others: tuple[str, ...]
) -> None:
    """Put all decisions of a data set into one file."""
    remedied = load(Remedied, files.decision("remedies"))
    decisions = (
        *load(PreparationPlan, files.decision("preparation")).decisions,
        load(FoldPlan, files.decision("folds")).decision,
        load(DelayChoice, files.decision("delay")).decision,
        *(load(StructureSearch, files.search(each)).decision for each in structures),
        *load(Comparison, files.decision("comparison")).decisions,
    )
    other = load(OtherModel, files.other_errors(others[0])) if others else None
    record = DecisionRecord(
        *(remedied.choice.purpose, decisions, remedied.trials, remedied.failed),
        *(remedied.statements, other),
    )
    save(record, files.decisions)
