"""The keys of a data set with several channels: checked, completed, and back to YAML."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from evopem.config.geometry_keys import check_geometry, geometry_keys, geometry_of
from evopem.config.input_constraint_keys import (
    check_focus,
    check_input_constraints,
    check_one_input,
    input_constraint_keys,
    input_constraints_of,
)
from evopem.config.input_ranges import (
    check_ends,
    check_input_ranges,
    check_one_range,
    input_range_keys,
    input_ranges_of,
    ranges_of_one_input,
)
from evopem.config.settings import Range, SplitSettings
from evopem.config.source_keys import check_file_paths
from evopem.config.split_keys import check_fractions, check_something_left
from evopem.config.state_space_settings import (
    ChannelLists,
    MultichannelDataset,
    MultichannelSource,
    OrderRanges,
    Reference,
    StateSpaceChoices,
    StateSpaceSearchSettings,
    UnitSettings,
    is_pattern,
    is_polynomial,
)
from evopem.config.strict_yaml import Keys
from evopem.config.structures import STRUCTURES, has_input
from evopem.config.values import ALL_SAMPLES
from evopem.config.yaml_form import dataset_yaml, files_of, one_or_list
from evopem.errors import InputError
from evopem.files.json_form import from_json, to_json

STRUCTURE = "state_space"
NO_INPUT = "none"
OWN_KEYS = ("form", "weighting", "geometry")
"""Keys that single-channel structures do not have."""

_STATE_SPACE_ONLY = ("form", "weighting")

_CHANNEL_KEYS = ("input", "output")
_UNIT_KEYS = ("input_unit", "output_unit")
_COLUMN_KEYS = (
    *("sampling_rate", "time", "time_unit", "header_lines", "decimal_mark"),
    "uneven_time",
)
_ANALYSIS_KEYS = (
    *("recipe", "purpose", "resample", "split", "structure", "form", "weighting"),
    *("delay", "orders", "search", "geometry", "focus", "constraints"),
)
# What ``defaults:`` says of these is for data sets with one input and one output.
_WRITTEN_ONLY = ("focus", "constraints")
KEYS = ("file", *_CHANNEL_KEYS, *_UNIT_KEYS, *_COLUMN_KEYS, "validation_file", *_ANALYSIS_KEYS)
_OWN_ORDERS = ("nx", "nf")
"""Orders whose ranges single-channel data sets do not have."""
_RANGES = ("nx", "joint", "na", "nc", "nd")
_RANGES_OF_INPUTS = ("nb", "nf")
_SEARCH_KEYS = ("seed", "evaluations", "max_root_radius", "objective")


def is_state_space(written: Keys, defaults: Keys) -> bool:
    """Whether a data set has the keys of several channels, or structure state_space."""
    channels = [written.get(key) for key in _CHANNEL_KEYS]
    lists = any(isinstance(each, list) or is_pattern(each) for each in channels)
    return lists or written.get("structure", defaults.get("structure")) == STRUCTURE


def single_channel_defaults(defaults: Keys) -> dict[str, Any]:
    """What ``defaults:`` says to data sets with one input and one output."""
    own = {key: value for key, value in defaults.items() if key not in OWN_KEYS}
    if own.get("structure") == STRUCTURE:
        del own["structure"]
    if "orders" in own:
        own["orders"] = {k: each for k, each in own["orders"].items() if k not in _OWN_ORDERS}
    return ranges_of_one_input(own)


def check_single_channel(written: Keys, source: str, place: str) -> None:
    """Refuse keys of several channels in a data set with one input and one output.

    Raises
    ------
    InputError
    """
    check_one_input(written, source, place)
    check_one_range(written, source, place)
    foreign = [f"{place}.{key}" for key in OWN_KEYS if key in written]
    foreign += [f"{place}.{key}" for key in _UNIT_KEYS if not isinstance(written.get(key, ""), str)]
    foreign += [f"{place}.orders.{key}" for key in _OWN_ORDERS if key in written.get("orders", {})]
    if foreign:
        raise InputError(
            source,
            "the key belongs to a data set with several channels",
            f"write structure: {STRUCTURE}, or remove it",
            foreign[0],
        )


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
    _check_structure(written, defaults, source, place)
    inherited = [key for key in _ANALYSIS_KEYS if key in defaults and key not in _WRITTEN_ONLY]
    own = {key: defaults[key] for key in inherited} | dict(written)
    structure = own.get("structure")
    _check_keys(written, structure, source, place)
    if structure is not None and is_polynomial(structure):
        own = {key: own[key] for key in own if key not in _STATE_SPACE_ONLY}
    for group in ("split", "delay", "orders", "search"):
        own[group] = {**defaults.get(group, {}), **written.get(group, {})}
    own["orders"] = _of_structure(own["orders"], structure)
    _check_weighting(own, source, place)
    check_focus(own, source, place)
    _check_split(own, written, source, place)
    check_file_paths(own, source, place)
    if "time" in own and "sampling_rate" in own:
        raise InputError(
            source, "both sampling_rate and time are given", "give one of the two", place
        )
    inputs = _references(own.get("input", 1), "input", source, place)
    outputs = _references(own.get("output", 2), "output", source, place)
    _check_distinct(inputs, outputs, own.get("time"), source, place)
    _check_units(own, inputs, outputs, source, place)
    check_input_ranges(own, inputs, source, place)
    check_input_constraints(written, structure, inputs, source, place)
    if not inputs:
        _check_without_input(own, written, source, place)
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
        inputs=_listed(keys.get("input", 1)),
        outputs=_listed(keys.get("output", 2)),
        input_units=_units(keys.get("input_unit", "")),
        output_units=_units(keys.get("output_unit", "")),
        **{key: keys[key] for key in _COLUMN_KEYS if key in keys},
    )
    search = {key: keys["search"][key] for key in _SEARCH_KEYS if key in keys["search"]}
    resample = keys.get("resample", "none")
    given = {key: keys[key] for key in ("structure", "focus", *_STATE_SPACE_ONLY) if key in keys}
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
        **{key: getattr(channels, key) for key in _COLUMN_KEYS},
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


def _check_structure(written: Keys, defaults: Keys, source: str, place: str) -> None:
    """Refuse a structure that does not have the channels."""
    structure = written.get("structure", defaults.get("structure"))
    where = "" if "structure" in written else " (from defaults)"
    inputs = _listed(written.get("input", 1))
    outputs = _listed(written.get("output", 2))
    if structure is not None and is_polynomial(structure):
        if len(outputs) > 1 or any(map(is_pattern, outputs)):
            raise InputError(
                source,
                f"there is a list of outputs, and structure {structure}{where} has one output",
                f"write structure: {STRUCTURE}, or name one channel",
                f"{place}.output",
            )
        if not has_input(structure):
            raise InputError(
                source,
                f"there is a list of channels, and structure {structure}{where} has no input",
                f"write structure: {STRUCTURE}, or name one output and no input",
                f"{place}.structure",
            )
        if not inputs:
            raise InputError(
                source,
                f"structure {structure}{where} needs an input, and there is none",
                f"write structure: {STRUCTURE}, or name an input",
                f"{place}.input",
            )
    if written.get("recipe") == "chapter":
        raise InputError(
            source,
            "the chapter's recipe has one input and one output",
            "remove the key: models of several channels are found by recipe auto",
            f"{place}.recipe",
        )


def _check_keys(written: Keys, structure: str | None, source: str, place: str) -> None:
    """Refuse keys that a data set with several channels does not have."""
    if "file" not in written:
        problem = (
            "a synthetic data set has one input and one output"
            if "synthesis" in written
            else "the key file is missing"
        )
        raise InputError(source, problem, "give the file of a recording", place)
    polynomial = structure is not None and is_polynomial(structure)
    outputs = _listed(written.get("output", 2))
    ranges = _orders_of(structure)
    if structure is None and (len(outputs) > 1 or is_pattern(outputs[0])):
        ranges = ("nx",)
    known: dict[str, tuple[str, ...]] = {"orders": ranges, "delay": ("nk",), "search": _SEARCH_KEYS}
    keys = tuple(key for key in KEYS if not (polynomial and key in _STATE_SPACE_ONLY))
    paths: list[tuple[str, tuple[str, ...], str]] = [(key, keys, key) for key in written]
    for group, names in known.items():
        paths += [(key, names, f"{group}.{key}") for key in written.get(group, {})]
    for key, names, path in paths:
        if key not in names:
            raise InputError(
                source,
                f"{_described(structure)} has no such key",
                f"remove it, or give one of {', '.join(names)}",
                f"{place}.{path}",
            )
    for name in _RANGES:
        limits = _range(written.get("orders", {}).get(name))
        if limits:
            check_ends(limits, source, f"{place}.orders.{name}")


def _orders_of(structure: str | None) -> tuple[str, ...]:
    """The orders of a structure that have ranges; None is any structure of one output."""
    if structure is None:
        return ("nx", "joint")
    if not is_polynomial(structure):
        return ("nx",)
    return ("joint", *(name for name in STRUCTURES[structure] if name != "nk"))


def _of_structure(orders: Keys, structure: str | None) -> dict[str, Any]:
    """The orders that a structure has, of those that ``defaults:`` may give for all."""
    return {name: orders[name] for name in orders if name in _orders_of(structure)}


def _check_weighting(own: Keys, source: str, place: str) -> None:
    """Refuse the determinant of absolute errors."""
    absolute = own["search"].get("objective") == "absolute"
    if absolute and own.get("weighting") == "determinant":
        raise InputError(
            source,
            "absolute errors have no covariance whose determinant could be taken",
            "write weighting: noise or power, or search.objective: quadratic",
            f"{place}.weighting",
        )


def _described(structure: str | None) -> str:
    """What a data set with several channels is called in an error."""
    if structure is None:
        return "a data set with several channels"
    return f"structure {structure}" + (" with several inputs" if is_polynomial(structure) else "")


def _check_split(own: Keys, written: Keys, source: str, place: str) -> None:
    if "by" in written.get("split", {}) and len(files_of(written["file"])) == 1:
        raise InputError(
            source,
            "the key is for several recordings, and there is one",
            "remove it",
            f"{place}.split.by",
        )
    check_fractions(own["split"], source, place)
    estimation = own["split"].get("estimation", 0.8)
    check_something_left(estimation, "validation_file" in written, source, place)


def _references(given: Any, role: str, source: str, place: str) -> tuple[Reference, ...]:
    """The channels of one role, each once."""
    references = _listed(given)
    if not references and role == "output":
        raise InputError(source, "there is no output", "name one", f"{place}.output")
    twice = next((each for each, count in Counter(references).items() if count > 1), None)
    if twice is not None:
        raise InputError(
            source, f"{twice} stands there twice", "name each channel once", f"{place}.{role}"
        )
    return references


def _check_distinct(
    inputs: Sequence[Reference],
    outputs: Sequence[Reference],
    time: Reference | None,
    source: str,
    place: str,
) -> None:
    """Refuse a channel with two roles."""
    roles = {"input": inputs, "output": outputs, "time": () if time is None else (time,)}
    for one, other in (("input", "output"), ("time", "input"), ("time", "output")):
        both = next((each for each in roles[other] if each in roles[one]), None)
        if both is not None:
            raise InputError(
                source,
                f"{both} is both {one} and {other}",
                "name two different columns",
                f"{place}.{other}",
            )


def _check_units(
    own: Keys,
    inputs: Sequence[Reference],
    outputs: Sequence[Reference],
    source: str,
    place: str,
) -> None:
    """Refuse lists of units that are not as long as the lists of channels."""
    for role, channels in (("input", inputs), ("output", outputs)):
        units = own.get(f"{role}_unit", "")
        patterns = any(is_pattern(each) for each in channels)
        if isinstance(units, list) and not patterns and len(units) != len(channels):
            raise InputError(
                source,
                f"there are {len(units)} units and {len(channels)} {role}s",
                "give one unit for each, one for all, or a mapping by their names",
                f"{place}.{role}_unit",
            )


def _check_without_input(own: Keys, written: Keys, source: str, place: str) -> None:
    """Refuse keys that need an input."""
    for key in ("input_unit", "delay"):
        if key in written:
            raise InputError(source, "there is no input", "remove the key", f"{place}.{key}")
    if own.get("form", "innovations") != "innovations":
        raise InputError(
            source,
            f"form {own['form']} has a plant that inputs drive",
            "write innovations, or remove the key",
            f"{place}.form",
        )
    if own.get("purpose") == "simulation":
        raise InputError(
            source,
            "without an input there is nothing to simulate",
            "write prediction, modes or auto",
            f"{place}.purpose",
        )


def _listed(given: Any) -> tuple[Reference, ...]:
    if isinstance(given, list | tuple):
        return tuple(given)
    return () if given == NO_INPUT else (given,)


def _ranges(orders: Keys, delay: Keys) -> OrderRanges:
    """The ranges of checked keys."""
    nx, joint, na, nc, nd = (_range(orders.get(name)) for name in _RANGES)
    nb, nf = (input_ranges_of(orders.get(name)) for name in _RANGES_OF_INPUTS)
    return OrderRanges(nx, joint, na, nc, nd, nb, nf, input_ranges_of(delay.get("nk")))


def _range_keys(ranges: OrderRanges) -> dict[str, Any]:
    """The keys that give the ranges of orders."""
    limits = {name: getattr(ranges, name) for name in _RANGES}
    keys = {name: each and list(each) for name, each in limits.items()}
    keys |= {name: input_range_keys(getattr(ranges, name)) for name in _RANGES_OF_INPUTS}
    return {name: each for name, each in keys.items() if each}


def _range(given: Any) -> Range | None:
    if given is None or given == "auto":
        return None
    return (given[0], given[1]) if isinstance(given, list | tuple) else (given, given)


def _units(given: Any) -> UnitSettings:
    if isinstance(given, Mapping):
        return UnitSettings(by_name=dict(given))
    if isinstance(given, list | tuple):
        return UnitSettings(in_order=tuple(given))
    return UnitSettings(all=given)


def _unit_keys(units: UnitSettings) -> Any:
    return units.by_name or list(units.in_order) or units.all
