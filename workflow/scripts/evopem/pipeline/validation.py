"""Validation: residual tests, errors, evidence for each mode; tables, decisions and summary."""

from __future__ import annotations

from pathlib import Path

from evopem.automatic.decision import OtherModel
from evopem.automatic.remedies import Remedied
from evopem.blas_threads import one_blas_thread
from evopem.config.defaults import yaml_text
from evopem.config.settings import DatasetSettings, SpectrumSettings
from evopem.config.structures import plant_order
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.files.atomic import write_table, write_text
from evopem.files.checksums import delete_results
from evopem.files.json_form import load, save
from evopem.models.mode_matching import OrderModel, OrderModels
from evopem.pipeline.decisions import collect_decisions, summarize_dataset, tabulate_candidates
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared
from evopem.validation.mode_evidence import with_noise_modes
from evopem.validation.responses import held_out_stretches
from evopem.validation.validate import validate, validation_errors


def complete_results(
    files: DatasetFiles,
    settings: DatasetSettings,
    phases: tuple[str, ...],
    structures: tuple[str, ...],
    phase: str | None,
    others: tuple[str, ...],
) -> None:
    """Validate the model, and write what is known of the data set: tables, decisions, summary.

    ``phases`` and ``structures`` that were searched; ``phase`` as for :func:`validate_model`;
    ``others``: the purpose whose model is kept beside the chosen one, or none.
    """
    validate_model(files, phase, settings.spectrum)
    tabulate_candidates(files, phases, structures)
    if not phases:
        other = _errors_of_other(files, others[0]) if others else None
        collect_decisions(files, structures, other)
    summarize_dataset(files, phases, structures)
    delete_results(files.folder, {Path(files.details).name})  # its contents are written anew
    write_text(files.config, yaml_text(settings))


def _errors_of_other(files: DatasetFiles, purpose: str) -> OtherModel:
    """What the model for another purpose reaches on the validation samples."""
    record = load(ModelRecord, files.other_model(purpose))
    prepared = load_prepared(files.prepared, files.transforms)
    fitted_level = record.level_of_simulation == "state"
    with one_blas_thread():
        held_out = held_out_stretches(record.model, prepared, fitted_level)
        return OtherModel(purpose, record.text, *validation_errors(held_out, fitted_level))


def validate_model(files: DatasetFiles, phase: str | None, spectrum: SpectrumSettings) -> None:
    """Validate the model on samples that it was not estimated from.

    ``phase``: the phase over whose models the modes are compared; None for the automatic recipe,
    where these are the models of all orders of the chosen structure.
    """
    record = load(ModelRecord, files.model)
    prepared = load_prepared(files.prepared, files.transforms)
    order, models = _models_of_orders(files, record, phase)
    with one_blas_thread():
        validation, tables = validate(
            record.model,
            prepared,
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
    best: dict[int, OrderModel] = {}
    if phase is None:
        chosen = load(Remedied, files.decision("remedies")).choice.candidate
        path = files.models_of_orders(chosen.structure)
        order = chosen.order
        if Path(path).exists():
            best = {each.order: each for each in load(OrderModels, path).models}
    else:
        name = plant_order(record.structure)
        order = getattr(record.polynomials.orders.single, name)
        for each in load(PhaseSelection, files.phase(phase)).candidates:
            found = getattr(each.orders.single, name)
            if found not in best or each.criteria.bic < best[found].bic:
                best[found] = OrderModel.of(found, each.criteria.bic, each.model)
    model = record.model if record.orders is not None else record.plant
    best[order] = OrderModel.of(order, record.bic, model)
    return order, tuple(best[each] for each in sorted(best))
