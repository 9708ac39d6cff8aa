"""The model that the automatic recipe chose, and the record of its decisions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np

from evopem.automatic.chosen import estimate_choice, window_of
from evopem.automatic.chosen import estimate_chosen as search_chosen
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.delays import DelayChoice
from evopem.automatic.folds import FoldPlan
from evopem.automatic.orders import StructureSearch
from evopem.automatic.preparation import PreparationPlan
from evopem.automatic.record import DecisionRecord, OtherModel
from evopem.automatic.remedies import Remedied
from evopem.automatic.structures import Comparison, Purpose
from evopem.automatic.subspace_comparison import SUBJECT
from evopem.blas_threads import one_blas_thread
from evopem.config.settings import Objective, SearchSettings
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_selection import complete_estimate
from evopem.files.json_form import load, save
from evopem.pipeline.preparation import load_record
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared
from evopem.signals.recording import total_samples
from evopem.signals.recording_info import RecordingInfo
from evopem.validation.responses import held_out_samples, responses_of
from evopem.validation.scores import error_percent

Log = Callable[[str], None]


def estimate_chosen(files: DatasetFiles, search: SearchSettings, log: Log | None = None) -> None:
    """Search the chosen structure and orders once more, globally."""
    record = load_record(files)
    data = load_prepared(files.prepared, files.transforms).estimation
    remedied = load(Remedied, files.decision("remedies"))
    settings = replace(search, objective=cast("Objective", record.plan.objective))
    with one_blas_thread():
        selection = search_chosen(remedied, record, data, settings, log)
    save(selection, files.phase(selection.phase))


def complete_other_model(files: DatasetFiles, purpose: Purpose, search: SearchSettings) -> None:
    """Keep the model for another purpose, with its errors on the validation samples.

    It is the one of the comparison of structures, without remedies and without a global search.
    """
    record = load_record(files)
    prepared = load_prepared(files.prepared, files.transforms)
    choice = load(Comparison, files.decision("comparison")).choice(purpose)
    settings = replace(search, objective=cast("Objective", record.plan.objective))
    with one_blas_thread():
        selected = estimate_choice(choice, record, prepared.estimation, settings)
        estimate = complete_estimate(
            selected, prepared.estimation, settings, window_of(selected.orders)
        )
        free_level = choice.level == "state"
        held_out = held_out_samples(estimate.model, prepared, free_level)
        responses = responses_of(estimate.model, prepared, held_out, free_level)
    scored = responses.scored
    measured = responses.output[scored]
    other = OtherModel(
        purpose,
        str(selected.orders),
        error_percent(measured, responses.predicted[scored]),
        error_percent(measured, responses.simulated[scored]),
    )
    save(
        ModelRecord.of(estimate, prepared.estimation, settings, prepared.transforms, choice.level),
        files.other_model(purpose),
    )
    save(other, files.other_errors(purpose))


def collect_decisions(files: DatasetFiles, structures: tuple[str, ...], other: str) -> None:
    """Put all decisions of a data set into one file, in their order."""
    plan = load(PreparationPlan, files.decision("preparation"))
    folds = load(FoldPlan, files.decision("folds"))
    comparison = load(Comparison, files.decision("comparison"))
    remedied = load(Remedied, files.decision("remedies"))
    decisions: tuple[Decision, ...] = (
        *_about_channels(load(RecordingInfo, files.recording_info)),
        *plan.decisions,
        folds.decision,
        folds.repetition.decision,
        load(DelayChoice, files.decision("delay")).decision,
        *(load(StructureSearch, files.search(each)).decision for each in structures),
        *comparison.decisions,
    )
    choice = remedied.choice
    record = DecisionRecord(
        *(choice.purpose, decisions, remedied.trials, remedied.failed),
        (*_remarks(files, choice.level), *_worse_than_peer(comparison), *remedied.statements),
        load(OtherModel, files.other_errors(other)),
    )
    save(record, files.decisions)


def _worse_than_peer(comparison: Comparison) -> tuple[str, ...]:
    """What is to be said where a short method simulates clearly better than the chosen model."""
    about = next(each for each in comparison.decisions if each.subject == SUBJECT)
    return () if about.choice == about.alternatives[0].name else (about.sentence,)


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
