"""The record of all decisions about a data set."""

from __future__ import annotations

import numpy as np

from evopem.automatic.candidates import StructureSearch
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.delays import DelayChoice
from evopem.automatic.held_out.folds import FoldPlan
from evopem.automatic.preparation.plan import PreparationPlan
from evopem.automatic.record import DecisionRecord, OtherModel
from evopem.automatic.remedies import Remedied
from evopem.automatic.structures import Comparison
from evopem.automatic.subspace_comparison import SUBJECT
from evopem.files.json_form import load, save
from evopem.pipeline.search.estimation_samples import load_record
from evopem.results.layout import DatasetFiles
from evopem.signals.recording import total_samples
from evopem.signals.recording_info import RecordingInfo


def collect_decisions(
    files: DatasetFiles, structures: tuple[str, ...], others: tuple[str, ...]
) -> None:
    """Put all decisions of a data set into one file, in their order."""
    folds = load(FoldPlan, files.decision("folds"))
    comparison = load(Comparison, files.decision("comparison"))
    remedied = load(Remedied, files.decision("remedies"))
    decisions: tuple[Decision, ...] = (
        *_about_channels(load(RecordingInfo, files.recording_info)),
        *load(PreparationPlan, files.decision("preparation")).decisions,
        folds.decision,
        folds.repetition.decision,
        load(DelayChoice, files.decision("delay")).decision,
        *(load(StructureSearch, files.search(each)).decision for each in structures),
        *comparison.decisions,
    )
    choice = remedied.choice
    remarks = *_remarks(files, choice.level), *_worse_than_estimate(comparison)
    other = load(OtherModel, files.other_errors(others[0])) if others else None
    record = DecisionRecord(
        *(choice.purpose, decisions, remedied.trials, remedied.failed),
        *((*remarks, *remedied.statements), other),
    )
    save(record, files.decisions)


def _worse_than_estimate(comparison: Comparison) -> tuple[str, ...]:
    """What is to be said where a short method simulates clearly better than the chosen model."""
    compared = [each for each in comparison.decisions if each.subject == SUBJECT]
    return tuple(each.sentence for each in compared if each.choice != each.alternatives[0].name)


def _about_channels(recording: RecordingInfo) -> tuple[Decision, ...]:
    """How input and output were told from the file; nothing where the configuration names them."""
    roles = recording.roles
    if roles is None:
        return ()
    pairs = (f"{roles.input} to {roles.output}", f"{roles.output} to {roles.input}")
    test = roles.test
    scores = (test.forward, test.backward) if test else (np.nan, np.nan)
    criterion = (
        f"p-value of the first one's past in predictions of the second, {test.lags} lags"
        if test
        else "names of the channels"
    )
    alternatives = tuple(map(Alternative, pairs, scores))
    return (Decision("channels", pairs[0], alternatives, criterion, roles.sentence),)


def _remarks(files: DatasetFiles, level: str) -> tuple[str, ...]:
    stretches = load_record(files).stretches
    recordings = len({each.recording for each in stretches})
    remarks = []
    if recordings > 1:
        remarks.append(
            f"The estimation samples are those of {recordings} recordings: one model comes from all"
            f" {total_samples(stretches)} of them, each recording with a level and an initial state"
            " of its own. Simulations of other recordings fit their level along with the initial"
            " state. The spectrum is that of the longest stretch."
        )
    elif len(stretches) > 1:
        longest = max(each.samples for each in stretches)
        remarks.append(
            f"The estimation samples are {len(stretches)} stretches with breaks between them: the"
            f" model comes from all {total_samples(stretches)} samples, each stretch with its own"
            f" initial state, the spectrum from the longest stretch of {longest} samples."
        )
    if level == "state" and recordings == 1:
        remarks.append(
            "The level drifts: simulations of other samples fit their level along with the initial"
            " state."
        )
    return tuple(remarks)
