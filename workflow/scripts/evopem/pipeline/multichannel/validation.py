"""Validation of a model of several channels and of its modes."""

from __future__ import annotations

from evopem.automatic.remedies import Remedied
from evopem.blas_threads import one_blas_thread
from evopem.estimation.model_record import ModelRecord
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.models.stabilization import OrderModel, OrderModels
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared
from evopem.signals.recording import Recording
from evopem.validation.mode_table import table_of_models
from evopem.validation.modes_record import ModesRecord
from evopem.validation.multichannel import validate_multichannel


def validate_state_space(files: DatasetFiles) -> None:
    """Validate the model and its modes on samples that no choice has seen."""
    record = load(ModelRecord, files.model)
    data = load_prepared(files.prepared, files.transforms)
    prepared = data.validation
    with one_blas_thread():
        free_level = record.level_of_simulation == "state"
        validation, tables = validate_multichannel(
            record.state_space, prepared, free_level, before=data.before_validation
        )
        modes = _judged_modes(files, record, prepared)
    save(modes, files.modes_json)
    write_table(files.modes, modes.rows())
    save(validation, files.validation)
    write_table(files.simulation, tables.simulation)
    write_table(files.residual_autocorrelation, tables.residual_autocorrelation)
    write_table(files.cross_correlation, tables.cross_correlation)


def _judged_modes(files: DatasetFiles, record: ModelRecord, validation: Recording) -> ModesRecord:
    """The modes of the model and of the other orders of its form, with their evidence."""
    chosen = load(Remedied, files.decision("remedies")).choice.candidate
    searched = load(OrderModels, files.models_of_orders(chosen.structure))
    completed = OrderModel.of(chosen.order, chosen.bic, record.plant)
    table = table_of_models(searched.with_model(completed).models, chosen.order, validation, 0)
    return ModesRecord.of(table, record.input_names, record.output_names)
