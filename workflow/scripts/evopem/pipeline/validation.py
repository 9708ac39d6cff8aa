"""Validation: residual tests, errors, evidence for each mode; the other model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

from evopem.automatic.candidates import Scorer
from evopem.automatic.chosen import estimate_chosen, window_of
from evopem.automatic.decision import OtherModel
from evopem.automatic.fit import FitSettings
from evopem.automatic.preparation.plan import PreparedRecord
from evopem.automatic.remedies import Remedied
from evopem.automatic.structures import Choice, Comparison, Purpose
from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import AutomaticSettings, Objective, SearchSettings, SpectrumSettings
from evopem.config.settings import FitSettings as FocusAndConstraints
from evopem.config.structures import plant_order
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_selection import complete_estimate
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.models.mode_matching import OrderModel, OrderModels
from evopem.pipeline.chosen import record_of_channels
from evopem.pipeline.structures import errors_name_dataset, load_record, load_scorer
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared
from evopem.validation.mode_evidence import with_noise_modes
from evopem.validation.responses import held_out_stretches
from evopem.validation.validate import validate, validation_errors


def validate_model(files: DatasetFiles, phase: str | None, spectrum: SpectrumSettings) -> None:
    """Validate the model on samples that it was not estimated from.

    ``phase``: the phase over whose models the modes are compared; None for several channels, of
    which these are the models of all orders of the chosen structure.
    """
    record = load(ModelRecord, files.model)
    prepared = load_prepared(files.prepared, files.transforms)
    order, models = _models_of_orders(files, record, phase)
    with one_blas_thread():
        validation, tables = validate(
            record.model,
            prepared,
            record.window.loss_start if record.window else None,
            record.search.settings.objective,
            models,
            order,
            spectrum,
            free_level=record.level_of_simulation == "state",
        )
    save(validation, files.validation)
    modes = with_noise_modes(validation.modes, record.noise_modes, len(record.input_names))
    write_table(files.modes, modes.rows(record.input_names, record.output_names))
    write_table(files.residual_autocorrelation, tables.residual_autocorrelation)
    write_table(files.cross_correlation, tables.cross_correlation)
    write_table(files.simulation, tables.simulation)
    write_table(files.horizons, tables.horizons)


def _models_of_orders(
    files: DatasetFiles, record: ModelRecord, phase: str | None
) -> tuple[int, tuple[OrderModel, ...]]:
    """The order of the model, and the plants of all orders with this one among them."""
    if phase is None:
        chosen = load(Remedied, files.decision("remedies")).choice.candidate
        path = files.models_of_orders(chosen.structure)
        order = chosen.order
        searched = load(OrderModels, path) if Path(path).exists() else OrderModels(())
    else:
        name = plant_order(record.structure)
        order = getattr(record.polynomials.orders.single, name)
        best: dict[int, OrderModel] = {}
        for each in load(PhaseSelection, files.phase(phase)).over_orders(record.structure):
            found = getattr(each.orders.single, name)
            if found not in best or each.criteria.bic < best[found].bic:
                best[found] = OrderModel.of(found, each.criteria.bic, each.model)
        searched = OrderModels(tuple(best.values()))
    model = record.model if record.orders is not None else record.plant
    return order, searched.with_model(OrderModel.of(order, record.bic, model)).models


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
    """
    prepared = load_prepared(files.prepared, files.transforms)
    choice = load(Comparison, files.decision("comparison")).choice(purpose)
    polynomials = choice.candidate.polynomials
    with errors_name_dataset(files), one_blas_thread():
        if polynomials is not None and polynomials.inputs == 1:
            scorer = load_scorer(files, settings, fits)
            record = _of_one_channel(scorer, load_record(files), prepared, choice, search)
        else:
            quick, none = replace(search, evaluations=0), replace(settings, evaluations=0)
            fit = FocusAndConstraints(constraints=constraints)
            record, _ = record_of_channels(files, choice, quick, none, fits, fit)
        fitted_level = choice.level == "state"
        held_out = held_out_stretches(record.model, prepared, fitted_level)
        errors = validation_errors(held_out, fitted_level)
    save(record, files.other_model(purpose))
    save(OtherModel(purpose, record.text, *errors), files.other_errors(purpose))


def _of_one_channel(
    scorer: Scorer,
    record: PreparedRecord,
    prepared: PreparedData,
    choice: Choice,
    search: SearchSettings,
) -> ModelRecord:
    """The model of one channel, at the optimum that the comparison found."""
    data, objective = prepared.estimation, cast("Objective", record.plan.objective)
    own = replace(search, objective=objective, evaluations=0)
    selection, _ = estimate_chosen(choice, scorer, record, data, own)
    window = window_of(selection.orders)
    estimate = complete_estimate(selection.selected, data, own, window)
    return ModelRecord.of(estimate, data, own, prepared.transforms, choice.level)
