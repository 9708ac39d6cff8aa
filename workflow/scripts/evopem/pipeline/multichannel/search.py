"""Delays, orders, structure and remedies for several channels: one file for each decision."""

from __future__ import annotations

from collections.abc import Callable

from evopem.automatic.candidates import (
    Scorer,
    StructureSearch,
    order_models,
    without_covariances,
)
from evopem.automatic.delays import DelayChoice, decide_delays
from evopem.automatic.fit import FitSettings
from evopem.automatic.folds import FoldPlan
from evopem.automatic.folds import decide_folds as decide_common_folds
from evopem.automatic.limits import OrderLimits
from evopem.automatic.orders import search_structure as search
from evopem.automatic.remedies import act_on_checks as act
from evopem.automatic.structures import Comparison
from evopem.automatic.structures import compare_structures as compare
from evopem.blas_threads import one_blas_thread
from evopem.config.settings import (
    InputRanges,
    OrderRanges,
    OutputWeighting,
    StateSpaceSearchSettings,
)
from evopem.files.json_form import load, save
from evopem.pipeline.multichannel.prepared import errors_name_dataset, load_prepared_channels
from evopem.results.layout import DatasetFiles
from evopem.signals.recording import Recording

Log = Callable[[str], None]


def decide_channel_folds(files: DatasetFiles) -> None:
    """Decide how held-out samples are divided."""
    with one_blas_thread():
        stretches = load_prepared_channels(files).estimation.segments
        save(decide_common_folds(stretches), files.decision("folds"))


def decide_input_delays(files: DatasetFiles, ranges: InputRanges) -> None:
    """Decide the delay of each input.

    Raises
    ------
    InputError
        When the ranges are those of other inputs.
    """
    estimation = load_prepared_channels(files).estimation
    with errors_name_dataset(files):
        choice = decide_delays(estimation.segments, estimation.input_names, ranges)
    save(choice, files.decision("delay"))


def search_channel_structure(
    files: DatasetFiles,
    structure: str,
    ranges: OrderRanges,
    search_settings: StateSpaceSearchSettings,
    weighting: OutputWeighting | None = None,
    log: Log | None = None,
) -> None:
    """Estimate all orders of a structure, and score them on held-out samples.

    Raises
    ------
    InputError
        When the record is too short.
    """
    estimation = load_prepared_channels(files).estimation
    scorer = _scorer(files, estimation, ranges, search_settings, weighting)
    with errors_name_dataset(files), one_blas_thread():
        found = search(scorer, structure, {}, log)
    save(without_covariances(found), files.search(structure))
    save(order_models(found, estimation), files.models_of_orders(structure))


def choose_channel_structure(
    files: DatasetFiles,
    structures: tuple[str, ...],
    ranges: OrderRanges,
    search_settings: StateSpaceSearchSettings,
    weighting: OutputWeighting | None = None,
) -> None:
    """Choose a model for each purpose among the candidates of all structures."""
    searches = [load(StructureSearch, files.search(each)) for each in structures]
    estimation = load_prepared_channels(files).estimation
    scorer = _scorer(files, estimation, ranges, search_settings, weighting)
    with errors_name_dataset(files), one_blas_thread():
        save(compare(scorer, searches), files.decision("comparison"))


def act_on_channel_checks(
    files: DatasetFiles,
    purpose: str,
    ranges: OrderRanges,
    search_settings: StateSpaceSearchSettings,
    weighting: OutputWeighting | None = None,
) -> None:
    """Apply remedies to the model for the purpose until its checks hold or nothing helps."""
    comparison = load(Comparison, files.decision("comparison"))
    estimation = load_prepared_channels(files).estimation
    scorer = _scorer(files, estimation, ranges, search_settings, weighting)
    choice = comparison.choice(purpose)  # type: ignore[arg-type]
    with errors_name_dataset(files), one_blas_thread():
        save(act(scorer, choice, comparison.candidates), files.decision("remedies"))


def fit_settings(
    search_settings: StateSpaceSearchSettings, weighting: OutputWeighting | None
) -> FitSettings:
    """What all fits have in common."""
    return FitSettings(
        search_settings.objective,
        weighting=weighting,
        max_root_radius=search_settings.max_root_radius,
        seed=search_settings.seed,
    )


def _scorer(
    files: DatasetFiles,
    estimation: Recording,
    ranges: OrderRanges,
    search_settings: StateSpaceSearchSettings,
    weighting: OutputWeighting | None,
) -> Scorer:
    return Scorer(
        estimation.segments,
        load(FoldPlan, files.decision("folds")),
        fit_settings(search_settings, weighting),
        OrderLimits(None, ranges, estimation.input_names),
        load(DelayChoice, files.decision("delay")).delays,
    )
