"""Validation: residual tests, one-step prediction, and simulation."""

from __future__ import annotations

from evopem.config.settings import SpectrumSettings
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared
from evopem.signals.spectral.summary import SpectrumSummary
from evopem.validation.validate import validate


def validate_model(files: DatasetFiles, phase: str) -> None:
    """Validate the model on samples that it was not estimated from.

    Parameters
    ----------
    files : DatasetFiles
    phase : str
        The phase over whose models the modes are compared.
    """
    record = load(ModelRecord, files.model)
    prepared = load_prepared(files.prepared, files.transforms)
    models = load(PhaseSelection, files.phase(phase)).over_orders(record.structure)
    spectrum = load(SpectrumSummary, files.spectrum_summary)
    validation, tables = validate(
        record.polynomials,
        prepared,
        record.window.loss_start if record.window else None,
        record.search.settings.objective,
        [each.model for each in models if each.orders != record.orders],
        SpectrumSettings(spectrum.time_halfbandwidth, spectrum.nfft),
        free_level=record.level_of_simulation == "state",
    )
    save(validation, files.validation)
    write_table(files.residual_autocorrelation, tables.residual_autocorrelation)
    write_table(files.cross_correlation, tables.cross_correlation)
    write_table(files.simulation, tables.simulation)
    write_table(files.horizons, tables.horizons)
