"""Model: the selected candidate with its covariance, modes and frequency response."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from evopem.automatic.chosen import window_of
from evopem.automatic.preparation.plan import PreparationPlan
from evopem.automatic.remedies import Remedied
from evopem.config.settings import FitSettings, Objective, ScoringWindow, SearchSettings
from evopem.estimation.candidate import PhaseSelection
from evopem.estimation.model_record import LevelOfSimulation, ModelRecord
from evopem.estimation.order_selection import complete_estimate
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.models.matlab import save_model_mat
from evopem.models.response_tables import (
    frequency_response_table,
    time_response_table,
)
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared


def complete_model(
    files: DatasetFiles,
    search: SearchSettings,
    window: ScoringWindow | None,
    phases: tuple[str, ...],
    fit: FitSettings,
) -> None:
    """Complete the selected candidate, and write it for evopem, MATLAB and spreadsheets.

    With a focus or constraints, the model of its orders is estimated for these.
    """
    selected = load(PhaseSelection, files.phase(phases[-1])).selected
    prepared = load_prepared(files.prepared, files.transforms)
    level: LevelOfSimulation = "constant" if selected.with_level else "none"
    if window is None:
        plan = load(PreparationPlan, files.decision("preparation"))
        search = replace(search, objective=cast("Objective", plan.objective))
        level = load(Remedied, files.decision("remedies")).choice.level
        estimate = complete_estimate(
            selected, prepared.estimation, search, window_of(selected.orders), fit
        )
        estimate = replace(estimate, at_stability_bound=selected.at_stability_bound)
    else:
        estimate = complete_estimate(selected, prepared.estimation, search, window, fit)
    if level == "constant" and len(set(prepared.estimation.segment_recordings)) > 1:
        level = "state"  # each recording has a level of its own, and so have others
    record = ModelRecord.of(
        *(estimate, prepared.estimation, search, prepared.transforms, level),
        focus=fit.focus,
        constraints=fit.constraints,
    )
    save(record, files.model)
    save_model_mat(estimate.model, files.model_mat)
    write_table(
        files.frequency_response,
        frequency_response_table(record.model, record.input_names, record.output_names),
    )
    write_table(files.time_response, time_response_table(estimate.model))
