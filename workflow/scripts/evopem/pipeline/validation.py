"""Validation: residual tests, one-step prediction, and simulation."""

from __future__ import annotations

from evopem.estimation.model_record import ModelRecord
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.results.layout import DatasetFiles
from evopem.signals.preparation import load_prepared
from evopem.validation.validation import validate


def validate_model(files: DatasetFiles) -> None:
    """Validate the model on samples that it was not estimated from."""
    record = load(ModelRecord, files.model)
    prepared = load_prepared(files.prepared, files.transforms)
    validation, tables = validate(record.model, prepared, record.window.loss_start)
    save(validation, files.validation)
    write_table(files.residual_autocorrelation, tables.residual_autocorrelation)
    write_table(files.cross_correlation, tables.cross_correlation)
    write_table(files.simulation, tables.simulation)
