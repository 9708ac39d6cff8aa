"""The chosen model, searched globally, and the one for another purpose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np

from evopem.automatic.chosen import estimate_choice, select_structure, window_of
from evopem.automatic.chosen import estimate_chosen as search_chosen
from evopem.automatic.fit import FitSettings
from evopem.automatic.limits import OrderLimits
from evopem.automatic.record import OtherModel
from evopem.automatic.remedies import Remedied
from evopem.automatic.state_space import weighting_of
from evopem.automatic.state_space_chosen import ChosenModel, estimate_candidate
from evopem.automatic.structures import Choice, Comparison, Purpose
from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import (
    AutomaticSettings,
    Objective,
    SearchSettings,
    StateSpaceSearchSettings,
)
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_selection import complete_estimate
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.models.matlab import save_model_mat
from evopem.models.response_tables import frequency_response_table
from evopem.pipeline.search.estimation_samples import errors_name_dataset, load_record, load_scorer
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared
from evopem.signals.recording import Recording
from evopem.signals.spectral.frequency_response import frequency_response
from evopem.validation.responses import held_out_stretches
from evopem.validation.validate import validation_errors

NFFT = 1024
Log = Callable[[str], None]


def estimate_chosen(
    files: DatasetFiles,
    search: SearchSettings,
    settings: AutomaticSettings,
    fits: FitSettings,
    log: Log | None = None,
) -> None:
    """Describe all candidates of one channel, and search the chosen orders globally."""
    record = load_record(files)
    data = load_prepared(files.prepared, files.transforms).estimation
    comparison = load(Comparison, files.decision("comparison"))
    remedied = load(Remedied, files.decision("remedies"))
    chosen = comparison.choice(settings.purpose).candidate
    about = next(each for each in comparison.decisions if each.choice == chosen.name)
    window = load_scorer(files, settings, fits).window
    own = replace(search, objective=cast("Objective", record.plan.objective))
    with one_blas_thread():
        structures = select_structure(
            comparison.candidates, chosen, about.sentence, record, data, window
        )
        selection = search_chosen(remedied, record, data, own, log)
    save(structures, files.phase(structures.phase))
    save(selection, files.phase(selection.phase))


def complete_channel_model(
    files: DatasetFiles,
    search: StateSpaceSearchSettings,
    settings: AutomaticSettings,
    fits: FitSettings,
    constraints: Constraints | None = None,
    log: Log | None = None,
) -> None:
    """Search the chosen model of several channels globally, and add its noise model.

    Raises InputError when the record is too short, or no model of the order meets the constraints.
    """
    data = load_prepared(files.prepared, files.transforms)
    choice = load(Remedied, files.decision("remedies")).choice
    with errors_name_dataset(files):
        found = _estimated(data, choice, search, settings, fits, constraints, log)
    record = _record(found, data, choice, search, fits, constraints)
    save(record, files.model)
    save_model_mat(record.model, files.model_mat)
    with one_blas_thread():
        write_table(files.frequency_response, _frequency_response(record, data.estimation))


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
            quick = StateSpaceSearchSettings(
                search.seed, 0, search.max_root_radius, search.objective
            )
            found = _estimated(prepared, choice, quick, settings, fits, constraints, None)
            record = _record(found, prepared, choice, quick, fits, constraints)
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


def _estimated(
    data: PreparedData,
    choice: Choice,
    search: StateSpaceSearchSettings,
    settings: AutomaticSettings,
    fits: FitSettings,
    constraints: Constraints | None,
    log: Log | None,
) -> ChosenModel:
    limits = OrderLimits(None, settings.orders, data.estimation.input_names)
    own = replace(fits, objective=search.objective)
    return estimate_candidate(
        *(choice.candidate, data.estimation, own, limits, constraints, search.evaluations, log)
    )


def _record(
    found: ChosenModel,
    data: PreparedData,
    choice: Choice,
    search: StateSpaceSearchSettings,
    fits: FitSettings,
    constraints: Constraints | None,
) -> ModelRecord:
    """Everything that is known of a model of several channels."""
    structure = choice.candidate.structure
    weighting = "determinant"
    if choice.candidate.polynomials is None:
        weighting = weighting_of(structure, replace(fits, objective=search.objective))
    return ModelRecord.of(
        *(found.estimate, data.estimation, search, data.transforms, choice.level),
        model=None if found.polynomials else found.model,
        variant=(structure, weighting),
        constraints=constraints,
        at_upper_ends=found.at_upper_ends,
    )


def _frequency_response(record: ModelRecord, estimation: Recording) -> dict[str, Any]:
    """The responses of model and noise filter, beside the measured ones."""
    plant = None if record.orders is not None else record.plant
    names = record.input_names, record.output_names
    if not record.has_input:
        return frequency_response_table(record.model, *names, plant)
    # Enough tapers for the spectral matrix of the inputs to be inverted.
    width = max(4.0, 2.0 * len(record.input_names) + 1.0)
    measured = frequency_response(estimation, min(width, estimation.longest.samples / 4.0), NFFT)
    response = measured.response.transpose(1, 2, 0)
    coherence = measured.coherence.T[:, None].repeat(response.shape[1], axis=1)
    return {
        **frequency_response_table(record.model, *names, plant, measured.frequencies),
        "measured_gain": np.abs(response).ravel(),
        "measured_phase_deg": np.degrees(np.angle(response)).ravel(),
        "coherence": coherence.ravel(),
    }
