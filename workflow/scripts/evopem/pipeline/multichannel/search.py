"""Delays of the inputs, and the search over the orders of each form with a weighting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from evopem.automatic.delays import DelayChoice, decide_delays
from evopem.automatic.multi_input_choice import search_structure, searched_joint_orders
from evopem.automatic.searched_forms import search_variant
from evopem.automatic.searched_orders import searched_orders
from evopem.automatic.variant_search import Variant
from evopem.config.settings import (
    InputRanges,
    OrderRanges,
    SearchSettings,
    StateSpaceSearchSettings,
)
from evopem.config.structures import ONE_OUTPUT, is_polynomial
from evopem.files.json_form import load, save
from evopem.pipeline.multichannel.prepared import errors_name_dataset, load_prepared_channels
from evopem.results.layout import DatasetFiles

Log = Callable[[str], None]


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


def search_state_space(
    files: DatasetFiles,
    structure: str,
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
    variant = variant_named(structure)
    estimation = load_prepared_channels(files).estimation
    settings = estimation_settings(search)
    delays = load(DelayChoice, files.decision("delay")).delays
    with errors_name_dataset(files):
        if is_polynomial(variant.form):
            joint = searched_joint_orders(estimation, variant.form, delays, ranges)
            found, models = search_structure(estimation, variant, joint, settings, log)
        else:
            orders = searched_orders(estimation, ranges.nx)
            found, models = search_variant(estimation, variant, delays, orders, settings, log)
    save(found, files.search(variant.name))
    save(models, files.models_of_orders(variant.name))


def variant_named(name: str) -> Variant:
    """A form with its weighting, by the name of its file."""
    form, _, weighting = name.rpartition("_")
    own = (name, ONE_OUTPUT) if is_polynomial(name) else (form, weighting)
    return Variant(*own)  # type: ignore[arg-type]


def estimation_settings(search: StateSpaceSearchSettings) -> SearchSettings:
    """The settings of a search as the estimation takes them."""
    settings = SearchSettings(
        objective=search.objective, seed=search.seed, max_root_radius=search.max_root_radius
    )
    if search.evaluations is None:
        return settings
    return replace(settings, evaluations=search.evaluations)
