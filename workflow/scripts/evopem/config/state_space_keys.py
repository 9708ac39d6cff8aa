"""The keys of a data set with several channels: completed, as settings, and back to YAML."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evopem.config.geometry_keys import check_geometry, geometry_keys, geometry_of
from evopem.config.input_constraint_keys import (
    check_focus,
    check_input_constraints,
    input_constraint_keys,
    input_constraints_of,
)
from evopem.config.input_ranges import (
    check_input_ranges,
    input_range_keys,
    input_ranges_of,
    ranges_of_one_input,
)
from evopem.config.settings import SplitSettings
from evopem.config.source_keys import check_file_paths
from evopem.config.state_space_checks import (
    ANALYSIS_KEYS,
    CHANNEL_KEYS,
    COLUMN_KEYS,
    NO_INPUT,
    OWN_KEYS,
    OWN_ORDERS,
    RANGES,
    RANGES_OF_INPUTS,
    SEARCH_KEYS,
    STATE_SPACE_ONLY,
    STRUCTURE,
    check_distinct,
    check_keys,
    check_split,
    check_structure,
    check_units,
    check_weighting,
    check_without_input,
    checked_references,
    listed,
    orders_of_structure,
    range_of,
)
from evopem.config.state_space_settings import (
    ChannelLists,
    MultichannelDataset,
    MultichannelSource,
    OrderRanges,
    StateSpaceChoices,
    StateSpaceSearchSettings,
    UnitSettings,
    is_pattern,
    is_polynomial,
)
from evopem.config.strict_yaml import Keys
from evopem.config.values import ALL_SAMPLES
from evopem.config.yaml_form import dataset_yaml, files_of, one_or_list
from evopem.errors import InputError
from evopem.files.json_form import from_json, to_json

# What ``defaults:`` says of these is for data sets with one input and one output.
_WRITTEN_ONLY = ("focus", "constraints")


def is_state_space(written: Keys, defaults: Keys) -> bool:
    """Whether a data set has the keys of several channels, or structure state_space."""
    channels = [written.get(key) for key in CHANNEL_KEYS]
    lists = any(isinstance(each, list) or is_pattern(each) for each in channels)
    lists = lists or NO_INPUT in channels
    return lists or written.get("structure", defaults.get("structure")) == STRUCTURE


def single_channel_defaults(defaults: Keys) -> dict[str, Any]:
    """What ``defaults:`` says to data sets with one input and one output."""
    own = {key: value for key, value in defaults.items() if key not in OWN_KEYS}
    if own.get("structure") == STRUCTURE:
        del own["structure"]
    if "orders" in own:
        own["orders"] = {k: each for k, each in own["orders"].items() if k not in OWN_ORDERS}
    return ranges_of_one_input(own)


def complete_state_space(
    name: str, written: Keys, defaults: Keys, source: str
) -> MultichannelDataset:
    """Check and complete the keys of a data set with several channels.

    Parameters
    ----------
    name : str
    written, defaults : mapping
        Keys of the data set, and of ``defaults:``, of which those that it has apply.
    source : str
        Name of the configuration in an error.

    Raises
    ------
    InputError
    """
    place = f"datasets.{name}"
    check_structure(written, defaults, source, place)
    inherited = [key for key in ANALYSIS_KEYS if key in defaults and key not in _WRITTEN_ONLY]
    own = {key: defaults[key] for key in inherited} | dict(written)
    structure = own.get("structure")
    check_keys(written, structure, source, place)
    if structure is not None and is_polynomial(structure):
        own = {key: own[key] for key in own if key not in STATE_SPACE_ONLY}
    for group in ("split", "delay", "orders", "search"):
        own[group] = {**defaults.get(group, {}), **written.get(group, {})}
    own["orders"] = orders_of_structure(own["orders"], structure)
    check_weighting(own, source, place)
    check_focus(own, source, place)
    check_split(own, written, source, place)
    check_file_paths(own, source, place)
    if "time" in own and "sampling_rate" in own:
        raise InputError(
            source, "both sampling_rate and time are given", "give one of the two", place
        )
    inputs = checked_references(own.get("input", 1), "input", source, place)
    outputs = checked_references(own.get("output", 2), "output", source, place)
    check_distinct(inputs, outputs, own.get("time"), source, place)
    check_units(own, inputs, outputs, source, place)
    check_input_ranges(own, inputs, source, place)
    check_input_constraints(written, structure, inputs, source, place)
    if not inputs:
        check_without_input(own, written, source, place)
    geometry = own.get("geometry")
    if geometry is not None:
        check_geometry(geometry, source, f"{place}.geometry")
    if "validation_file" not in own:
        own["split"] = {"estimation": 0.8} | own["split"]
    else:
        own["split"] = {"estimation": ALL_SAMPLES} | own["split"]
    return state_space_settings(name, own)


def state_space_settings(name: str, keys: Keys) -> MultichannelDataset:
    """The settings of complete, checked keys."""
    channels = ChannelLists(
        inputs=listed(keys.get("input", 1)),
        outputs=listed(keys.get("output", 2)),
        input_units=_units(keys.get("input_unit", "")),
        output_units=_units(keys.get("output_unit", "")),
        **{key: keys[key] for key in COLUMN_KEYS if key in keys},
    )
    search = {key: keys["search"][key] for key in SEARCH_KEYS if key in keys["search"]}
    resample = keys.get("resample", "none")
    given = {key: keys[key] for key in ("structure", "focus", *STATE_SPACE_ONLY) if key in keys}
    geometry = keys.get("geometry")
    return MultichannelDataset(
        name=name,
        source=MultichannelSource(
            tuple(files_of(keys["file"])),
            channels,
            tuple(files_of(keys.get("validation_file"))),
        ),
        split=from_json(SplitSettings, {"discard": 0, **keys["split"]}),
        resample=None if resample == "none" else float(resample),
        rate_given="resample" in keys,
        choices=StateSpaceChoices(
            purpose=keys.get("purpose", "auto"),
            orders=_ranges(keys.get("orders", {}), keys.get("delay", {})),
            **given,
        ),
        search=from_json(StateSpaceSearchSettings, search),
        geometry=None if geometry is None else geometry_of(geometry),
        constraints=input_constraints_of(keys["constraints"]) if "constraints" in keys else None,
    )


def keys_of_state_space(settings: MultichannelDataset) -> dict[str, Any]:
    """List the keys that give these settings; what is decided from the recording is left out."""
    source, choices = settings.source, settings.choices
    channels = source.channels
    orders, nk = _range_keys(choices.orders), input_range_keys(choices.orders.nk)
    split = ("discard", "estimation", *(["by"] if len(source.files) > 1 else []))
    keys: dict[str, Any] = {
        "file": one_or_list(source.files),
        "input": list(channels.inputs) or NO_INPUT,
        "output": list(channels.outputs),
        "input_unit": _unit_keys(channels.input_units),
        "output_unit": _unit_keys(channels.output_units),
        **{key: getattr(channels, key) for key in COLUMN_KEYS},
        "validation_file": one_or_list(source.validation_files),
        "recipe": "auto",
        "purpose": choices.purpose,
        "resample": (settings.resample or "none") if settings.rate_given else None,
        "split": {key: getattr(settings.split, key) for key in split},
        "structure": choices.structure,
        "form": choices.form,
        "focus": choices.focus,
        "weighting": choices.weighting,
        "delay": {"nk": nk} if nk else None,
        "orders": orders or None,
        "search": {k: v for k, v in to_json(settings.search).items() if v is not None},
        "geometry": None if settings.geometry is None else geometry_keys(settings.geometry),
        "constraints": None
        if settings.constraints is None
        else input_constraint_keys(settings.constraints),
    }
    return {key: value for key, value in keys.items() if value is not None and value != ""}


def state_space_yaml(settings: MultichannelDataset) -> str:
    """Write a configuration with this one data set, ready to be run again."""
    return dataset_yaml(settings.name, keys_of_state_space(settings))


def _ranges(orders: Keys, delay: Keys) -> OrderRanges:
    """The ranges of checked keys."""
    nx, joint, na, nc, nd = (range_of(orders.get(name)) for name in RANGES)
    nb, nf = (input_ranges_of(orders.get(name)) for name in RANGES_OF_INPUTS)
    return OrderRanges(nx, joint, na, nc, nd, nb, nf, input_ranges_of(delay.get("nk")))


def _range_keys(ranges: OrderRanges) -> dict[str, Any]:
    """The keys that give the ranges of orders."""
    limits = {name: getattr(ranges, name) for name in RANGES}
    keys = {name: each and list(each) for name, each in limits.items()}
    keys |= {name: input_range_keys(getattr(ranges, name)) for name in RANGES_OF_INPUTS}
    return {name: each for name, each in keys.items() if each}


def _units(given: Any) -> UnitSettings:
    if isinstance(given, Mapping):
        return UnitSettings(by_name=dict(given))
    if isinstance(given, list | tuple):
        return UnitSettings(in_order=tuple(given))
    return UnitSettings(all=given)


def _unit_keys(units: UnitSettings) -> Any:
    return units.by_name or list(units.in_order) or units.all
