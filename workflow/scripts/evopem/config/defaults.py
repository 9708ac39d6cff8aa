"""Complete a configuration: built-in values, then ``defaults:``, then a data set's own keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from evopem.config.automatic_keys import built_in_keys, check_automatic_keys, laid_over
from evopem.config.batches import batches_of, check_batches, with_jobs
from evopem.config.configuration import Configuration, order_of
from evopem.config.dataset_names import check_names
from evopem.config.fit_keys import merged_fit
from evopem.config.sample_sheet import Origin, expand, shard_of, with_matching_files
from evopem.config.schema import check_schema
from evopem.config.settings import (
    DatasetSettings,
    OrderGrid,
    PreparationSettings,
    Recipe,
    RunSettings,
    Structure,
    SyntheticSource,
)
from evopem.config.source_keys import check_paths, complete_source
from evopem.config.split_keys import check_fractions, check_something_left
from evopem.config.state_space_checks import check_single_channel
from evopem.config.state_space_keys import (
    as_single,
    complete_state_space,
    single_channel_defaults,
)
from evopem.config.strict_yaml import Keys
from evopem.config.structures import AUTOMATIC_STRUCTURES, STRUCTURES, has_input, phases_of
from evopem.config.values import ALL_SAMPLES, normalized
from evopem.config.yaml_form import ANALYSIS_KEYS, analysis_keys, is_state_space, settings_of
from evopem.errors import InputError
from evopem.files.json_form import from_json, to_json

# Why a structure does not search an order.
_REASONS = {
    "joint": "its only order is nb",
    "nc": "it has no polynomial C",
    "nd": "it has no polynomial D",
    "na": "it has no polynomial A",
    "nb": "it has no input",
}
_INPUT_KEYS = ("input", "input_unit")


def with_ranges(keys: Keys) -> dict[str, Any]:
    """Copy keys with every fixed order, such as 4, written as the range [4, 4]."""
    changed = dict(keys)
    for group in ("delay", "orders"):
        if group in changed:
            changed[group] = {
                key: [value, value]
                if isinstance(value, int) and not isinstance(value, bool)
                else value
                for key, value in changed[group].items()
            }
    return changed


def check_structure_keys(written: Keys, structure: str, source: str, place: str) -> None:
    """Refuse keys of orders that a structure does not have.

    Parameters
    ----------
    written : mapping
        Keys as they were written.
    structure : str
    source, place : str
        The configuration and the key of the data set, for an error to name.

    Raises
    ------
    InputError
    """
    phases = phases_of(structure)
    for key in written.get("orders", {}):
        if key not in phases:
            reason = _REASONS[key]
            if key == "na" and "na" in STRUCTURES[structure]:
                reason = "the degree of its A is the joint order"
            raise InputError(
                source,
                f"structure {structure} has no such search: {reason}",
                f"remove it, or give one of {', '.join(p for p in phases if p != 'delay')}",
                f"{place}.orders.{key}",
            )
    if has_input(structure):
        return
    for key in ("delay", *_INPUT_KEYS):
        if key in written:
            raise InputError(
                source, f"structure {structure} has no input", "remove the key", f"{place}.{key}"
            )


def check_transforms(analysis: Keys, structure: str, source: str, place: str) -> None:
    """Refuse transforms of an input that the structure does not have.

    Raises
    ------
    InputError
    """
    if not has_input(structure) and analysis["transforms"]["difference_input"]:
        raise InputError(
            source,
            f"structure {structure} has no input to difference",
            "set it to 0",
            f"{place}.transforms.difference_input",
        )


def check_several_recordings(settings: DatasetSettings, source: str) -> None:
    """Refuse keys that have no meaning for several recordings of one data set.

    Parameters
    ----------
    settings : DatasetSettings
    source : str
        The configuration, for an error to name.

    Raises
    ------
    InputError
    """
    recorded = settings.source
    if isinstance(recorded, SyntheticSource) or len(recorded.files) == 1:
        return
    place = f"datasets.{settings.name}"
    split = settings.preparation.split
    whole_recordings = split.by == "recordings" and not recorded.validation_files
    if whole_recordings and isinstance(split.estimation, int):
        raise InputError(
            source,
            f"{split.estimation} is a number of samples, and whole recordings are held out",
            "give a fraction between 0 and 1, or write by: samples beside it to cut each recording",
            f"{place}.split.estimation",
        )
    if settings.is_single_channel and settings.fit.changes_model:
        key = "constraints" if settings.fit.constraints else "focus"
        raise InputError(
            source,
            f"the key is for a data set of one recording, and this one has {len(recorded.files)}",
            "remove the key, or give one file",
            f"{place}.{key}",
        )


BUILT_IN_RECIPE: Recipe = "auto"


def complete(config: Keys, schema_path: str | Path, source: str = "config.yaml") -> Configuration:
    """Check a configuration and fill in every value the user left out.

    Parameters
    ----------
    config : mapping
        The configuration as the user wrote it.
    schema_path : path
        The JSON schema, as YAML.
    source : str
        Name of the configuration in an error.

    Returns
    -------
    Configuration

    Raises
    ------
    InputError
        In one sentence that names the key, its value, what is wrong and what to do.
    """
    schema = yaml.safe_load(Path(schema_path).read_text(encoding="utf-8"))
    config = dict(normalized(config, source))
    datasets, origin = expand(config.get("datasets"), source)
    try:
        if "datasets" in config:
            datasets = with_matching_files(datasets, source)
            config["datasets"] = normalized(datasets, source, ("datasets",))
        check_schema(config, schema, source)
        return _completed(config, origin, source)
    except InputError as error:
        raise _placed(error, datasets, origin) from None


def _completed(config: Keys, origin: Origin, source: str) -> Configuration:
    """Fill in every value of a configuration that the schema accepts."""
    check_names(config["datasets"], origin)
    given_defaults = config.get("defaults", {})
    defaults = with_ranges(single_channel_defaults(given_defaults))
    structure = defaults.get("structure", OrderGrid().structure)
    if "structure" in defaults:
        check_structure_keys(defaults, structure, source, "defaults")
    everything = _every_key(structure)
    _check_analysis(defaults, _merged(everything, defaults), source, "defaults")
    datasets = {
        name: _dataset(name, entry, given_defaults, defaults, source)
        for name, entry in config["datasets"].items()
    }
    check_paths(config["datasets"], source)
    for each in datasets.values():
        check_several_recordings(each, source)
    names = [field.name for field in fields(RunSettings)]
    given_run = {name: config[name] for name in names if name in config}
    run = from_json(RunSettings, given_run, source)
    check_batches(run, source)
    run = with_jobs(run, len(datasets))
    batches = batches_of(datasets, run.recordings_per_job)
    if batches and run.shard:
        # Whole batches: the run that makes the lists has the same ones.
        batches = shard_of(batches, run.shard, source)
        datasets = {name: datasets[name] for batch in batches.values() for name in batch}
    elif run.shard:
        datasets = shard_of(datasets, run.shard, source)
    conditions = {name: given.get("conditions", {}) for name, given in config["datasets"].items()}
    order = order_of(conditions, config["follow"], source) if "follow" in config else None
    return Configuration(datasets, run, order, batches)


def _dataset(
    name: str, entry: Keys, given_defaults: Keys, defaults: Keys, source: str
) -> DatasetSettings:
    """Fill in every value of one data set; `defaults` are those of a single channel, completed."""
    given = {key: entry[key] for key in entry if key != "conditions"}
    if is_state_space(given, given_defaults):
        return complete_state_space(name, given, given_defaults, source)
    given = as_single(given)
    check_single_channel(given, source, f"datasets.{name}")
    written = with_ranges(given)
    if _recipe(written, defaults) == "auto":
        return _automatic(name, written, defaults, source)
    return _by_chapter(name, written, defaults, source)


def _by_chapter(name: str, written: Keys, defaults: Keys, source: str) -> DatasetSettings:
    """Fill in every value of a data set of the chapter's recipe."""
    place = f"datasets.{name}"
    if "purpose" in written:
        raise InputError(
            source,
            "the chapter's recipe knows no purpose",
            "remove the key, or write recipe: auto",
            f"{place}.purpose",
        )
    structure = written.get("structure", defaults.get("structure", OrderGrid().structure))
    check_structure_keys(written, structure, source, place)
    own_source = complete_source(written, source, place, has_input(structure))
    lowest = analysis_keys(PreparationSettings(), structure=structure)
    if "validation_file" in written:
        lowest = _merged(lowest, {"split": {"estimation": ALL_SAMPLES}})
    analysis = _merged(_merged(lowest, defaults), written)
    _check_analysis(written, analysis, source, place)
    check_transforms(analysis, structure, source, place)
    estimation = analysis["split"]["estimation"]
    check_something_left(estimation, "validation_file" in written, source, place)
    return settings_of(name, own_source | analysis | merged_fit(defaults, written))


def _recipe(written: Keys, defaults: Keys) -> Recipe:
    """The recipe of a data set: the chapter's for structures that the automatic one has not."""
    given: Recipe | None = written.get("recipe", defaults.get("recipe"))
    if given is not None:
        return given
    structure = written.get("structure", defaults.get("structure"))
    return BUILT_IN_RECIPE if structure in (None, *AUTOMATIC_STRUCTURES) else "chapter"


def _automatic(name: str, written: Keys, defaults: Keys, source: str) -> DatasetSettings:
    """The settings of a data set of the automatic recipe."""
    place = f"datasets.{name}"
    check_automatic_keys(defaults, source, "defaults")
    check_automatic_keys(written, source, place)
    for keys, at in ((defaults, "defaults"), (written, place)):
        if "structure" in keys:
            check_structure_keys(keys, keys["structure"], source, at)
    own_source = complete_source(written, source, place)
    lowest = built_in_keys()
    if "validation_file" in written:
        lowest["split"] = {"estimation": ALL_SAMPLES}
    own = {key: value for key, value in written.items() if key in ANALYSIS_KEYS}
    analysis = laid_over(laid_over(lowest, defaults), own)
    _check_analysis(written, analysis, source, place)
    estimation = analysis["split"]["estimation"]
    check_something_left(estimation, "validation_file" in written, source, place)
    return settings_of(name, own_source | analysis | merged_fit(defaults, written))


def _every_key(structure: Structure) -> dict[str, Any]:
    """The built-in values of all keys of the analysis, those of every structure's phases too."""
    keys = analysis_keys(PreparationSettings(), structure=structure)
    grid: dict[str, Any] = to_json(OrderGrid(structure=structure))
    return keys | {group: {k: _listed(v) for k, v in grid[group].items()} for group in _GROUPS}


def _listed(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


_GROUPS = ("delay", "orders")


def _placed(error: InputError, datasets: Any, origin: Origin) -> InputError:
    """Name the place in a table or a pattern's entry where an error's key was written."""
    names = datasets if isinstance(datasets, Mapping) else ()
    for name in sorted(map(str, names), key=len, reverse=True):
        place = f"datasets.{name}"
        rest = error.place.removeprefix(place)
        if rest != error.place and (not rest or rest[0] == "."):
            here = origin.of_key(name, rest.removeprefix("."))
            return InputError(origin.source, error.problem, error.remedy, here)
    return error


def _merged(lower: Keys, upper: Keys) -> dict[str, Any]:
    """Lay one mapping over another, key by key, in the lower one's order."""
    return {
        key: _merged(value, upper.get(key, {}))
        if isinstance(value, Mapping)
        else upper.get(key, value)
        for key, value in lower.items()
    }


def _ranges(analysis: Keys) -> Iterator[tuple[str, Any]]:
    for group in _GROUPS:
        for key, value in analysis.get(group, {}).items():
            yield f"{group}.{key}", value


def _check_analysis(written: Keys, merged: Keys, source: str, place: str) -> None:
    """Check what no schema can say, of values laid over the defaults.

    `written` decides which of the two keys in a conflict an error names: the one that stands
    in this part of the file.
    """
    for key, value in _ranges(merged):
        if isinstance(value, list) and value[0] > value[1]:
            raise InputError(
                source,
                f"the lower end of {value} is above the upper one",
                f"write [{value[1]}, {value[0]}]",
                f"{place}.{key}",
            )
    check_fractions(merged["split"], source, place)
    search = merged["search"]
    own = written.get("search", {})
    for low, high, meaning in (
        ("mu", "lambda", "as many offspring as parents are needed"),
        ("nu", "lambda", "no more individuals can be improved than there are offspring"),
    ):
        if search[low] > search[high]:
            key = low if low in own or high not in own else high
            raise InputError(
                source,
                f"{low} is {search[low]} and {high} is {search[high]}, but {meaning}",
                f"give {low} no more than {high}",
                f"{place}.search.{key}",
            )
