"""Validation: residual tests, one-step prediction, simulation, and the evidence for each mode."""

from __future__ import annotations

from pathlib import Path

from evopem.automatic.remedies import Remedied
from evopem.blas_threads import one_blas_thread
from evopem.config.settings import SpectrumSettings
from evopem.config.structures import plant_order
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.models.stabilization import OrderModel, OrderModels
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared
from evopem.validation.mode_evidence import with_noise_modes
from evopem.validation.validate import validate


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
