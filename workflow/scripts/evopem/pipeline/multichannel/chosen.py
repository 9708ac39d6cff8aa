"""The chosen model of several channels, and the one for the other purpose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from evopem.automatic.delays import DelayChoice
from evopem.automatic.record import OtherModel
from evopem.automatic.searched_forms import SearchedForms
from evopem.automatic.state_space_choice import ModelChoice, StateSpaceChoice
from evopem.automatic.state_space_chosen import ChosenModel
from evopem.automatic.state_space_remedies import RemediedModel, act_on_checks
from evopem.automatic.variant_search import Variant, VariantSearch
from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import OrderRanges, StateSpaceSearchSettings
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.multi_input.order_limits import OrderLimits, joint_orders
from evopem.files.atomic import write_table
from evopem.files.json_form import load, save
from evopem.models.matlab import save_model_mat
from evopem.models.stabilization import OrderModels
from evopem.models.state_space import StateSpaceModel
from evopem.pipeline.multichannel.candidates import candidates_table
from evopem.pipeline.multichannel.prepared import errors_name_dataset, load_prepared_channels
from evopem.pipeline.multichannel.search import estimation_settings
from evopem.results.layout import DatasetFiles
from evopem.results.multichannel import frequency_response_rows
from evopem.signals.prepared_data import PreparedData
from evopem.validation.multichannel import mean_errors

Log = Callable[[str], None]


def estimate_chosen_state_space(
    files: DatasetFiles,
    variants: tuple[Variant, ...],
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
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
    choice = load(StateSpaceChoice, files.decision("comparison")).model
    forms = _searched_forms(files, data, variants, ranges, search, constraints)
    with errors_name_dataset(files):
        remedied = act_on_checks(forms, choice, log)
    found = remedied.model
    record = _record(found, data, remedied.record.choice, search, constraints)
    save(record, files.model)
    save(remedied.record, files.decision("remedies"))
    write_table(files.candidates, _candidates(forms, choice, remedied))
    save_model_mat(record.model, files.model_mat)
    with one_blas_thread():
        write_table(files.frequency_response, frequency_response_rows(record, data.estimation))


def complete_other_state_space(
    files: DatasetFiles,
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
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
    choice = load(StateSpaceChoice, files.decision("comparison")).other
    assert choice is not None  # only data sets with inputs have another purpose
    with one_blas_thread():
        forms = _searched_forms(files, data, (), ranges, search, constraints)
        with errors_name_dataset(files):
            found = forms.as_searched(choice)
        record = _record(found, data, choice, search, constraints)
        errors = mean_errors(
            record.state_space, data.validation, choice.level == "state", data.before_validation
        )
    save(record, files.other_model(choice.purpose))
    save(OtherModel(choice.purpose, record.text, *errors), files.other_errors(choice.purpose))


def _searched_forms(
    files: DatasetFiles,
    data: PreparedData,
    variants: Sequence[Variant],
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
    constraints: Constraints | None,
) -> SearchedForms:
    """What the search over the orders of some forms has left."""

    def start(variant: Variant, order: int) -> StateSpaceModel:
        return load(OrderModels, files.models_of_orders(variant.name)).of_order(order)

    return SearchedForms(
        data.estimation,
        load(DelayChoice, files.decision("delay")).delays,
        tuple(load(VariantSearch, files.search(variant.name)) for variant in variants),
        start,
        estimation_settings(search),
        ranges,
        constraints,
    )


def _record(
    found: ChosenModel,
    data: PreparedData,
    choice: ModelChoice,
    search: StateSpaceSearchSettings,
    constraints: Constraints | None,
) -> ModelRecord:
    """Everything that is known of a model."""
    return ModelRecord.of(
        *(found.estimate, data.estimation, search, data.transforms, choice.level),
        model=None if found.polynomials else found.model,
        variant=(choice.variant.form, choice.variant.weighting),
        constraints=constraints,
        at_upper_ends=found.at_upper_ends,
    )


def _candidates(
    forms: SearchedForms, choice: ModelChoice, remedied: RemediedModel
) -> dict[str, list[Any]]:
    """The table of all candidates."""
    limits = OrderLimits.of(forms.ranges, forms.estimation.input_names)

    def orders_of(structure: str, order: int) -> str:
        return str(joint_orders(structure, order, forms.delays, limits))

    tried, trials = remedied.model.tried, remedied.record.trials
    return candidates_table(forms.searches, choice, orders_of, tried, trials)
