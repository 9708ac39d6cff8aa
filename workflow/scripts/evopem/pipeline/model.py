"""Model: the selected candidate with its covariance, modes and frequency response."""

from __future__ import annotations

from collections.abc import Sequence

from evopem.config.settings import FitSettings, ScoringWindow, SearchSettings
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_selection import complete_estimate
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.models.matlab import save_model_mat
from evopem.models.response_tables import (
    frequency_response_table,
    modes_table,
    time_response_table,
)
from evopem.results.layout import DatasetFiles
from evopem.signals.preparation import load_prepared


def complete_model(
    files: DatasetFiles,
    search: SearchSettings,
    window: ScoringWindow,
    phases: Sequence[str],
    fit: FitSettings,
) -> None:
    """Complete the selected candidate, and write it for evopem, MATLAB and spreadsheets.

    With a focus or constraints, the model of its orders is estimated for these.
    """
    selection = load(PhaseSelection, files.phase(phases[-1]))
    prepared = load_prepared(files.prepared, files.transforms)
    estimate = complete_estimate(selection.selected, prepared.estimation, search, window, fit)
    save(ModelRecord.of(estimate, search, prepared.transforms, fit), files.model)
    save_model_mat(estimate.model, files.model_mat)
    write_table(files.modes, modes_table(estimate.model))
    write_table(files.frequency_response, frequency_response_table(estimate.model))
    write_table(files.time_response, time_response_table(estimate.model))
