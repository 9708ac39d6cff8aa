"""Stages of a data set with several channels, from its recording to its results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from evopem.automatic.multi_input_choice import search_structure, searched_joint_orders
from evopem.automatic.multichannel_folds import describe_folds
from evopem.automatic.multichannel_preparation import (
    MultichannelPlan,
    apply_multichannel_plan,
    decide_multichannel_preparation,
)
from evopem.automatic.record import OtherModel
from evopem.automatic.state_space_choice import ModelChoice, StateSpaceChoice, choose
from evopem.automatic.state_space_chosen import ChosenModel
from evopem.automatic.state_space_remedies import (
    RemediedModel,
    RemedyRecord,
    SearchedForms,
    act_on_checks,
)
from evopem.automatic.state_space_search import (
    DelayChoice,
    Variant,
    VariantSearch,
    decide_delays,
    search_variant,
    searched_orders,
)
from evopem.config.constraints import InputConstraints
from evopem.config.input_ranges import InputRanges
from evopem.config.settings import SplitSettings
from evopem.config.state_space_keys import state_space_yaml
from evopem.config.state_space_settings import (
    ONE_OUTPUT,
    ChannelLists,
    Geometry,
    OrderRanges,
    StateSpaceChoices,
    StateSpaceDataset,
    StateSpaceSearchSettings,
    StateSpaceSource,
    is_polynomial,
    searched_variants,
)
from evopem.errors import InputError
from evopem.estimation.multi_input.order_limits import OrderLimits, joint_orders
from evopem.estimation.state_space.model_record import MultichannelModelRecord
from evopem.estimation.state_space.order_models import OrderModel, OrderModels
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.files.atomic import write_table, write_text
from evopem.files.checksums import delete_results
from evopem.files.json_form import load, save
from evopem.models.matlab import save_multi_input_mat, save_state_space_mat
from evopem.models.state_space import StateSpaceModel
from evopem.pipeline.multichannel_candidates import candidates_table
from evopem.pipeline.progress import Announce, Stage, run_stages
from evopem.results.layout import DatasetFiles
from evopem.results.multichannel import (
    DecisionList,
    frequency_response_rows,
    read_multichannel_results,
    summarize_multichannel,
)
from evopem.signals.joining import joined_multichannel
from evopem.signals.multichannel import MultichannelRecording, load_multichannel, save_multichannel
from evopem.signals.multichannel_preparation import (
    MultichannelData,
    divide_multichannel,
    load_multichannel_data,
    save_multichannel_data,
)
from evopem.signals.multichannel_reading import (
    check_measured_places,
    describe_multichannel,
    read_multichannel,
    with_time_told,
)
from evopem.signals.reading import uneven_times
from evopem.validation.mode_table import table_of_models
from evopem.validation.modes_record import ModesRecord
from evopem.validation.multichannel import mean_errors, validate_multichannel

Log = Callable[[str], None]
Estimated = TypeVar("Estimated")


def write_multichannel_configuration(files: DatasetFiles, settings: StateSpaceDataset) -> None:
    """Keep the complete configuration of a data set beside its results."""
    delete_results(files.folder, {Path(files.details).name})  # its contents are written anew
    write_text(files.config, state_space_yaml(settings))


def read_channels(
    recorded: Sequence[str],
    channels: ChannelLists,
    geometry: Geometry | None,
    place: str,
    recording_file: str,
    info_file: str,
) -> None:
    """Read the input and output channels of a recorded file, or of several that are one data set.

    Parameters
    ----------
    recorded : sequence of str
        The recorded files.
    channels : ChannelLists
    geometry : Geometry, optional
        Its channels must be outputs.
    place : str
        Configuration key of the data set, for an error to name.
    recording_file, info_file : str
        Where samples and origin are written.

    Raises
    ------
    InputError
        When a file cannot be read, or the recordings are not of the same channels and rate.
    """
    told = [with_time_told(file, channels) for file in recorded]
    recordings = [read_multichannel(*each) for each in zip(recorded, told, strict=True)]
    recording = joined_multichannel(recordings, recorded) if len(recordings) > 1 else recordings[0]
    check_measured_places(geometry, recording.output_names, f"{place}.geometry")
    save_multichannel(recording, recording_file)
    info = replace(
        describe_multichannel(recorded, recording),
        time_told=None if told[0] == channels else told[0].time,
        uneven_times=uneven_times(recorded, channels),
    )
    save(info, info_file)


def prepare_channels(
    files: DatasetFiles,
    source: StateSpaceSource,
    split: SplitSettings,
    resample: float | None,
    given: tuple[bool, bool],
) -> None:
    """Decide start and decimation from the estimation samples alone, and prepare both parts.

    Parameters
    ----------
    files : DatasetFiles
    source : StateSpaceSource
    split : SplitSettings
    resample : float, optional
        New sampling rate in Hz.
    given : (bool, bool)
        Whether the configuration states the start, and the rate.

    Raises
    ------
    InputError
        When the recording cannot be divided.
    """
    recording = load_multichannel(files.recording)
    validation = None
    if source.validation_files:
        validation = load_multichannel(files.validation_recording)
    place = f"datasets.{files.name}"
    recorded = (*source.files, *source.validation_files)
    divided = divide_multichannel(recording, split, resample, validation, place, recorded)
    with threadpool_limits(limits=1, user_api="blas"):
        plan = decide_multichannel_preparation(divided.estimation, *given)
        prepared = apply_multichannel_plan(divided, plan)
    plan = replace(plan, decisions=(*plan.decisions, describe_folds(prepared.estimation)))
    save(plan, files.decision("preparation"))
    save_multichannel_data(prepared, files.prepared, files.transforms)


def decide_input_delays(files: DatasetFiles, ranges: InputRanges) -> None:
    """Decide the delay of each input.

    Raises
    ------
    InputError
        When the ranges are those of other inputs.
    """
    try:
        choice = decide_delays(_prepared(files).estimation, ranges)
    except InputError as error:
        raise _of_dataset(f"datasets.{files.name}", error) from None
    save(choice, files.decision("delays"))


def search_state_space(
    files: DatasetFiles,
    variant: Variant,
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
    log: Log | None = None,
) -> None:
    """Estimate all orders of a form with a weighting, and score them on held-out samples.

    Raises
    ------
    InputError
        When the record is too short.
    """
    estimation = _prepared(files).estimation
    place = f"datasets.{files.name}"
    settings = _settings(search, variant)
    delays = load(DelayChoice, files.decision("delays")).delays
    try:
        if is_polynomial(variant.form):
            joint = searched_joint_orders(estimation, variant.form, delays, ranges)
            found, models = search_structure(estimation, variant, joint, settings, log)
        else:
            orders = searched_orders(estimation, ranges.nx)
            found, models = search_variant(estimation, variant, delays, orders, settings, log)
    except InputError as error:
        raise _of_dataset(place, error) from None
    except ValueError as error:
        raise _too_short(place, error) from None
    save(found, files.search(variant.name))
    save(models, files.models_of_orders(variant.name))


def choose_state_space(
    files: DatasetFiles, variants: Sequence[Variant], choices: StateSpaceChoices
) -> None:
    """Choose form, weighting and order by the errors on held-out samples."""
    searches = [load(VariantSearch, files.search(variant.name)) for variant in variants]
    save(choose(searches, choices), files.decision("comparison"))


def estimate_chosen_state_space(
    files: DatasetFiles,
    variants: Sequence[Variant],
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
    constraints: InputConstraints | None = None,
    log: Log | None = None,
) -> None:
    """Search the chosen model globally, add its noise model, and write what follows from it.

    Raises
    ------
    InputError
        When the record is too short, or no model of the order meets the constraints.
    """
    data = _prepared(files)
    choice = load(StateSpaceChoice, files.decision("comparison")).model
    forms = _searched_forms(files, data, variants, ranges, search, constraints)
    remedied = _of_record(files, partial(act_on_checks, forms, choice, log))
    found = remedied.model
    record = _record(found, data, remedied.record.choice, search, constraints)
    save(record, files.model)
    save(remedied.record, files.decision("remedies"))
    write_table(files.candidates, _candidates(forms, choice, remedied))
    if record.polynomials is None:
        save_state_space_mat(record.model, files.model_mat)
    else:
        save_multi_input_mat(record.polynomials, files.model_mat)
    with threadpool_limits(limits=1, user_api="blas"):
        write_table(files.frequency_response, frequency_response_rows(record, data.estimation))


def complete_other_state_space(
    files: DatasetFiles,
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
    constraints: InputConstraints | None = None,
) -> None:
    """Keep the model for the other purpose, with its errors on the validation samples.

    It is the one of the search over orders, without a global search of its own.

    Raises
    ------
    InputError
        When the record is too short.
    """
    data = _prepared(files)
    choice = load(StateSpaceChoice, files.decision("comparison")).other
    assert choice is not None  # only data sets with inputs have another purpose
    with threadpool_limits(limits=1, user_api="blas"):
        forms = _searched_forms(files, data, (), ranges, search, constraints)
        found = _of_record(files, partial(forms.as_searched, choice))
        record = _record(found, data, choice, search, constraints)
        errors = mean_errors(record.model, data.validation, choice.level == "state")
    save(record, files.other_model(choice.purpose))
    save(OtherModel(choice.purpose, record.text, *errors), files.other_errors(choice.purpose))


def _searched_forms(
    files: DatasetFiles,
    data: MultichannelData,
    variants: Sequence[Variant],
    ranges: OrderRanges,
    search: StateSpaceSearchSettings,
    constraints: InputConstraints | None,
) -> SearchedForms:
    """What the search over the orders of some forms has left."""

    def start(variant: Variant, order: int) -> StateSpaceModel:
        return load(OrderModels, files.models_of_orders(variant.name)).of_order(order)

    return SearchedForms(
        data.estimation,
        load(DelayChoice, files.decision("delays")).delays,
        tuple(load(VariantSearch, files.search(variant.name)) for variant in variants),
        start,
        partial(_settings, search),
        ranges,
        constraints,
    )


def _of_record(files: DatasetFiles, estimate: Callable[[], Estimated]) -> Estimated:
    """What is estimated from a record; an error names the key of the data set."""
    try:
        return estimate()
    except InputError as error:
        raise _of_dataset(f"datasets.{files.name}", error) from None
    except ValueError as error:
        raise _too_short(f"datasets.{files.name}", error) from None


def _record(
    found: ChosenModel,
    data: MultichannelData,
    choice: ModelChoice,
    search: StateSpaceSearchSettings,
    constraints: InputConstraints | None,
) -> MultichannelModelRecord:
    """Everything that is known of a model."""
    return MultichannelModelRecord.of(
        found.estimate,
        found.model,
        (choice.variant.form, choice.variant.weighting),
        (data.estimation.input_units, data.estimation.output_units),
        search,
        data.transforms,
        choice.level,
        found.polynomials,
        constraints,
        found.at_upper_ends,
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


def validate_state_space(files: DatasetFiles) -> None:
    """Validate the model and its modes on samples that no choice has seen."""
    record = load(MultichannelModelRecord, files.model)
    prepared = _prepared(files).validation
    with threadpool_limits(limits=1, user_api="blas"):
        free_level = record.level_of_simulation == "state"
        validation, tables = validate_multichannel(record.model, prepared, free_level)
        modes = _judged_modes(files, record, prepared)
    save(modes, files.modes_json)
    write_table(files.modes, modes.rows())
    save(validation, files.validation)
    write_table(files.simulation, tables.simulation)
    write_table(files.residual_autocorrelation, tables.residual_autocorrelation)
    write_table(files.cross_correlation, tables.cross_correlation)


def _judged_modes(
    files: DatasetFiles, record: MultichannelModelRecord, validation: MultichannelRecording
) -> ModesRecord:
    """The modes of the model and of the other orders of its form, with their evidence."""
    choice = load(RemedyRecord, files.decision("remedies")).choice
    searched = load(OrderModels, files.models_of_orders(choice.variant.name))
    own = OrderModel.of(choice.order, record.bic, record.plant)
    table = table_of_models(
        searched.with_model(own).models,
        choice.order,
        validation.input_records,
        validation.output_records,
        0,
    )
    return ModesRecord.of(table, record.input_names, record.output_names)


def collect_state_space_decisions(files: DatasetFiles) -> None:
    """Put all decisions of a data set into one file."""
    preparation = load(MultichannelPlan, files.decision("preparation"))
    delays = load(DelayChoice, files.decision("delays"))
    choice = load(StateSpaceChoice, files.decision("comparison"))
    decisions = (*preparation.decisions, delays.decision, *choice.decisions)
    other = None
    if choice.other is not None:
        other = load(OtherModel, files.other_errors(choice.other.purpose))
    remedies = load(RemedyRecord, files.decision("remedies"))
    save(DecisionList(choice.model.purpose, decisions, remedies, other), files.decisions)


def summarize_state_space(files: DatasetFiles) -> None:
    """Put order, errors, modes and checks of a data set into one small file."""
    save(summarize_multichannel(files), files.summary)


def write_state_space_report(
    files: DatasetFiles, settings: StateSpaceDataset, variants: Sequence[Variant]
) -> None:
    """Write the report of a data set as one HTML file."""
    from evopem.pipeline.report import commit_of
    from evopem.report.state_space_page import build_state_space_report
    from evopem.report.templates import template_folder

    results = read_multichannel_results(files, settings, [each.name for each in variants])
    templates = template_folder()
    from evopem.report.wall_clock import read_wall_clock

    wall_clock = read_wall_clock(Path(files.folder) / "benchmarks")
    commit = commit_of(templates.parent)
    page = build_state_space_report(results, wall_clock, templates, commit)
    write_text(files.report, page)


def channel_stages(
    files: DatasetFiles,
    settings: StateSpaceDataset,
    with_report: bool,
    log: Log | None = None,
) -> dict[str, Stage]:
    """List the stages of a data set by their names, in their order, ready to be called.

    Parameters are those of :func:`identify_channels`.
    """
    source, choices, search = settings.source, settings.choices, settings.search
    variants = variants_of(searched_variants(settings))
    given = (bool(settings.split.discard), settings.rate_given)
    read = partial(
        read_channels,
        channels=source.channels,
        geometry=settings.geometry,
        place=f"datasets.{files.name}",
    )
    listed: dict[str, Stage] = {
        "configuration": partial(write_multichannel_configuration, files, settings),
        "recording": partial(
            read, source.files, recording_file=files.recording, info_file=files.recording_info
        ),
    }
    if source.validation_files:
        listed["validation_recording"] = partial(
            read,
            source.validation_files,
            recording_file=files.validation_recording,
            info_file=files.validation_recording_info,
        )
    listed["preparation"] = partial(
        prepare_channels,
        *(files, source, settings.split, settings.resample, given),
    )
    listed["delays"] = partial(decide_input_delays, files, choices.orders.nk)
    for variant in variants:
        ranges = choices.orders.of_form(variant.form)
        listed[variant.name] = partial(search_state_space, files, variant, ranges, search, log)
    listed["structures"] = partial(choose_state_space, files, variants, choices)
    listed["chosen"] = partial(
        estimate_chosen_state_space,
        *(files, variants, choices.orders, search, settings.constraints, log),
    )
    if source.channels.inputs:
        listed["other_model"] = partial(
            complete_other_state_space, files, choices.orders, search, settings.constraints
        )
    listed["validation"] = partial(validate_state_space, files)
    listed["decisions"] = partial(collect_state_space_decisions, files)
    listed["summary"] = partial(summarize_state_space, files)
    if with_report:
        listed["report"] = partial(write_state_space_report, files, settings, variants)
    return listed


def identify_channels(
    files: DatasetFiles,
    settings: StateSpaceDataset,
    with_report: bool,
    log: Log | None = None,
    announce: Announce | None = None,
) -> None:
    """Take one data set from its recording to its results.

    Parameters
    ----------
    files : DatasetFiles
    settings : StateSpaceDataset
    with_report : bool
    log : callable, optional
        Receives progress in words.
    announce : callable, optional
        Receives each stage before it begins: its name, its number from 1, and how many there are.
    """
    run_stages(channel_stages(files, settings, with_report, log), announce)


def variant_named(name: str) -> Variant:
    """A form with its weighting, by the name of its file."""
    form, _, weighting = name.rpartition("_")
    return variants_of([(name, ONE_OUTPUT) if is_polynomial(name) else (form, weighting)])[0]


def variants_of(names: Sequence[tuple[str, str]]) -> list[Variant]:
    """Forms with their weightings."""
    return [Variant(form, weighting) for form, weighting in names]  # type: ignore[arg-type]


def _prepared(files: DatasetFiles) -> MultichannelData:
    return load_multichannel_data(files.prepared, files.transforms)


def _settings(search: StateSpaceSearchSettings, variant: Variant) -> StateSpaceSettings:
    return StateSpaceSettings(
        weighting=variant.weighting,
        max_root_radius=search.max_root_radius,
        seed=search.seed,
        evaluations=search.evaluations,
        objective=search.objective,
    )


def _of_dataset(place: str, error: InputError) -> InputError:
    """An error that names its argument, with the key of the data set."""
    key = ".".join(filter(None, (place, error.source, error.place)))
    return InputError(key, error.problem, error.remedy)


def _too_short(place: str, error: ValueError) -> InputError:
    return InputError(place, str(error), "give a longer recording, or lower the orders")
