"""What moves: a model with moving coefficients, where the machine seems to change."""

from dataclasses import replace

from evopem.arrays import one_blas_thread
from evopem.automatic.varying import table_of, what_moves
from evopem.config.settings import VaryingSettings
from evopem.estimation.model_record import ModelRecord
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared
from evopem.validation.validate import class_of


def estimate_varying(files: DatasetFiles, settings: VaryingSettings) -> None:
    """Try a model with moving coefficients where the machine seems to change."""
    record = load(ModelRecord, files.model)
    with one_blas_thread():
        prepared = load_prepared(files.prepared, files.transforms)
        tests = class_of(record.model, prepared, record.level_of_simulation == "state")
        varying = replace(what_moves(prepared, record, settings, tests), tests=tests)
    save(varying, files.varying)
    write_table(files.varying_modes, table_of(varying))
