"""The model for another purpose, beside the one of the configuration."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from evopem.automatic.chosen import estimate_choice, window_of
from evopem.automatic.fit import FitSettings
from evopem.automatic.record import OtherModel
from evopem.automatic.structures import Choice, Comparison, Purpose
from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import AutomaticSettings, Objective, SearchSettings
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_selection import complete_estimate
from evopem.files.json_form import load, save
from evopem.pipeline.search.chosen import estimated, record_of
from evopem.pipeline.search.estimation_samples import errors_name_dataset, load_record
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared
from evopem.validation.responses import held_out_stretches
from evopem.validation.validate import validation_errors


def complete_other(
    files: DatasetFiles,
    purpose: Purpose,
    search: SearchSettings,
    settings: AutomaticSettings,
    fits: FitSettings,
    constraints: Constraints | None = None,
) -> None:
    """Keep the model for another purpose, with its errors on the validation samples.

    It is the one of the comparison of structures, without acting on its checks and without a global
    search.  Constraints hold for models of several channels.

    Raises InputError when the record is too short.
    """
    prepared = load_prepared(files.prepared, files.transforms)
    choice = load(Comparison, files.decision("comparison")).choice(purpose)
    polynomials = choice.candidate.polynomials
    with errors_name_dataset(files), one_blas_thread():
        if polynomials is not None and polynomials.inputs == 1:
            record = _of_one_channel(files, prepared, choice, search)
        else:
            quick, none = replace(search, evaluations=0), replace(settings, evaluations=0)
            found = estimated(prepared, choice, quick, none, fits, constraints, None)
            record = record_of(found, prepared, choice, quick, fits, constraints)
        fitted_level = choice.level == "state"
        held_out = held_out_stretches(record.model, prepared, fitted_level)
        errors = validation_errors(held_out, fitted_level)
    save(record, files.other_model(purpose))
    save(OtherModel(purpose, record.text, *errors), files.other_errors(purpose))


def _of_one_channel(
    files: DatasetFiles, prepared: PreparedData, choice: Choice, search: SearchSettings
) -> ModelRecord:
    """The model of one channel."""
    record, data = load_record(files), prepared.estimation
    own = replace(search, objective=cast("Objective", record.plan.objective))
    selected = estimate_choice(choice, record, data, own)
    estimate = complete_estimate(selected, data, own, window_of(selected.orders))
    return ModelRecord.of(estimate, data, own, prepared.transforms, choice.level)
