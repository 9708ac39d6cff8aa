"""The chosen model of several channels, and the one for the other purpose."""

from __future__ import annotations

from collections.abc import Callable

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
    OrderRanges,
    OutputWeighting,
    StateSpaceSearchSettings,
)
from evopem.estimation.model_record import ModelRecord
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.models.matlab import save_model_mat
from evopem.pipeline.multichannel.prepared import errors_name_dataset, load_prepared_channels
from evopem.pipeline.multichannel.search import fit_settings
from evopem.results.layout import DatasetFiles
from evopem.results.multichannel import frequency_response_rows
from evopem.signals.prepared_data import PreparedData
from evopem.validation.multichannel import mean_errors

Log = Callable[[str], None]


def estimate_chosen_state_space(
    files: DatasetFiles,
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
    weighting: OutputWeighting | None = None,
    constraints: Constraints | None = None,
    log: Log | None = None,
) -> None:
    """Search the chosen model globally, add its noise model, and write what follows from it.

    Raises
    ------
    InputError
        When the record is too short, or no model of the order meets the constraints.
    """
    data = load_prepared_channels(files)
    choice = load(Remedied, files.decision("remedies")).choice
    settings, limits = _settings(data, ranges, search, weighting)
    with errors_name_dataset(files):
        found = estimate_candidate(
            *(choice.candidate, data.estimation, settings, limits, constraints),
            search.evaluations,
            log,
        )
    record = _record(found, data, choice, search, settings, constraints)
    save(record, files.model)
    save_model_mat(record.model, files.model_mat)
    with one_blas_thread():
        write_table(files.frequency_response, frequency_response_rows(record, data.estimation))


def complete_other_state_space(
    files: DatasetFiles,
    purpose: Purpose,
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
    weighting: OutputWeighting | None = None,
    constraints: Constraints | None = None,
) -> None:
    """Keep the model for the other purpose, with its errors on the validation samples.

    It is the one of the search over orders, without a global search of its own.

    Raises
    ------
    InputError
        When the record is too short.
    """
    data = load_prepared_channels(files)
    choice = load(Comparison, files.decision("comparison")).choice(purpose)
    settings, limits = _settings(data, ranges, search, weighting)
    with one_blas_thread():
        with errors_name_dataset(files):
            found = estimate_candidate(
                *(choice.candidate, data.estimation, settings, limits, constraints), 0
            )
        record = _record(found, data, choice, search, settings, constraints)
        errors = mean_errors(
            record.state_space, data.validation, choice.level == "state", data.before_validation
        )
    save(record, files.other_model(choice.purpose))
    save(OtherModel(choice.purpose, record.text, *errors), files.other_errors(choice.purpose))


def _settings(
    data: PreparedData,
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
    weighting: OutputWeighting | None,
) -> tuple[FitSettings, OrderLimits]:
    limits = OrderLimits(None, ranges, data.estimation.input_names)
    return fit_settings(search, weighting), limits


def _record(
    found: ChosenModel,
    data: PreparedData,
    choice: Choice,
    search: StateSpaceSearchSettings,
    settings: FitSettings,
    constraints: Constraints | None,
) -> ModelRecord:
    """Everything that is known of a model."""
    structure = choice.candidate.structure
    weighting = "determinant"
    if choice.candidate.polynomials is None:
        weighting = weighting_of(structure, settings)
    return ModelRecord.of(
        *(found.estimate, data.estimation, search, data.transforms, choice.level),
        model=None if found.polynomials else found.model,
        variant=(structure, weighting),
        constraints=constraints,
        at_upper_ends=found.at_upper_ends,
    )
