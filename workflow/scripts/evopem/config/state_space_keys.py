"""The keys of a data set with several channels, completed and checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evopem.config.geometry_keys import check_geometry
from evopem.config.input_constraint_keys import GAINS, check_focus, check_input_constraints
from evopem.config.input_ranges import OF_INPUTS, check_input_ranges, ranges_of_one_input
from evopem.config.settings import DatasetSettings, Reference
from evopem.config.source_keys import check_file_paths
from evopem.config.state_space_checks import (
    ANALYSIS_KEYS,
    OWN_ORDERS,
    check_distinct,
    check_keys,
    check_split,
    check_structure,
    check_units,
    check_weighting,
    check_without_input,
    checked_references,
    orders_of_structure,
)
from evopem.config.strict_yaml import Keys
from evopem.config.structures import is_polynomial
from evopem.config.values import ALL_SAMPLES
from evopem.config.yaml_form import (
    NO_INPUT,
    OWN_KEYS,
    STATE_SPACE_ONLY,
    STRUCTURE,
    listed,
    settings_of,
)
from evopem.errors import InputError

# What ``defaults:`` says of these is for data sets with one input and one output.
_WRITTEN_ONLY = ("focus", "constraints")


def as_single(written: Keys) -> dict[str, Any]:
    """The keys of a data set with one channel of each role, lists and mappings of one resolved."""
    own = dict(written)
    names = {"input": listed(written.get("input", 1)), "output": listed(written.get("output", 2))}
    for role, name in names.items():
        if role in own:
            own[role] = name[0] if name else NO_INPUT
        if f"{role}_unit" in own:
            own[f"{role}_unit"] = _of_one(own[f"{role}_unit"], name)
    for group, key in OF_INPUTS:
        if key in own.get(group, {}):
            own[group] = own[group] | {key: _of_one(own[group][key], names["input"])}
    if "constraints" in own:
        gains = {key: own["constraints"][key] for key in GAINS if key in own["constraints"]}
        gains = {
            key: _of_one(each, names["input"]) if isinstance(each, Mapping) else each
            for key, each in gains.items()
        }
        own["constraints"] = own["constraints"] | gains
    return own


def _of_one(given: Any, names: tuple[Reference, ...]) -> Any:
    """What a list of one, or a mapping from the one name, holds; anything else as it is."""
    if isinstance(given, Mapping) and list(given) == list(names):
        return given[names[0]]
    if isinstance(given, list) and len(given) == 1:
        return given[0]
    return given


def single_channel_defaults(defaults: Keys) -> dict[str, Any]:
    """What ``defaults:`` says to data sets with one input and one output."""
    own = {key: value for key, value in defaults.items() if key not in OWN_KEYS}
    if own.get("structure") == STRUCTURE:
        del own["structure"]
    if "orders" in own:
        own["orders"] = {k: each for k, each in own["orders"].items() if k not in OWN_ORDERS}
    return ranges_of_one_input(own)


def complete_state_space(name: str, written: Keys, defaults: Keys, source: str) -> DatasetSettings:
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
    return settings_of(name, own)
