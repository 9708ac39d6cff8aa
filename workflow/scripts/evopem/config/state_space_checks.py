"""Keys of a data set with several channels that are refused, each in a sentence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from evopem.config.input_constraint_keys import check_one_input
from evopem.config.input_ranges import check_ends, check_one_range
from evopem.config.settings import Reference, is_pattern
from evopem.config.split_keys import check_fractions, check_something_left
from evopem.config.strict_yaml import Keys
from evopem.config.structures import STRUCTURES, has_input, is_polynomial
from evopem.config.yaml_form import (
    COLUMN_KEYS,
    OWN_KEYS,
    RANGES,
    SEARCH_KEYS,
    STATE_SPACE_ONLY,
    STRUCTURE,
    files_of,
    listed,
    range_of,
)
from evopem.errors import InputError

CHANNEL_KEYS = ("input", "output")
UNIT_KEYS = ("input_unit", "output_unit")
ANALYSIS_KEYS = (
    *("recipe", "purpose", "resample", "split", "structure", "form", "weighting"),
    *("delay", "orders", "search", "geometry", "focus", "constraints"),
)
KEYS = ("file", *CHANNEL_KEYS, *UNIT_KEYS, *COLUMN_KEYS, "validation_file", *ANALYSIS_KEYS)
OWN_ORDERS = ("nx", "nf")
"""Orders whose ranges single-channel data sets do not have."""


def check_single_channel(written: Keys, source: str, place: str) -> None:
    """Refuse keys of several channels in a data set with one input and one output.

    Raises
    ------
    InputError
    """
    check_one_input(written, source, place)
    check_one_range(written, source, place)
    foreign = [f"{place}.{key}" for key in OWN_KEYS if key in written]
    foreign += [f"{place}.{key}" for key in UNIT_KEYS if not isinstance(written.get(key, ""), str)]
    foreign += [f"{place}.orders.{key}" for key in OWN_ORDERS if key in written.get("orders", {})]
    if foreign:
        raise InputError(
            source,
            "the key belongs to a data set with several channels",
            f"write structure: {STRUCTURE}, or remove it",
            foreign[0],
        )


def check_structure(written: Keys, defaults: Keys, source: str, place: str) -> None:
    """Refuse a structure that does not have the channels."""
    structure = written.get("structure", defaults.get("structure"))
    where = "" if "structure" in written else " (from defaults)"
    inputs = listed(written.get("input", 1))
    outputs = listed(written.get("output", 2))
    if not outputs:
        raise InputError(source, "there is no output", "name a channel", f"{place}.output")
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


def check_keys(written: Keys, structure: str | None, source: str, place: str) -> None:
    """Refuse keys that a data set with several channels does not have."""
    if "file" not in written:
        problem = (
            "a synthetic data set has one input and one output"
            if "synthesis" in written
            else "the key file is missing"
        )
        raise InputError(source, problem, "give the file of a recording", place)
    polynomial = structure is not None and is_polynomial(structure)
    outputs = listed(written.get("output", 2))
    ranges = _orders_of(structure)
    if structure is None and (len(outputs) > 1 or is_pattern(outputs[0])):
        ranges = ("nx",)
    known: dict[str, tuple[str, ...]] = {"orders": ranges, "delay": ("nk",), "search": SEARCH_KEYS}
    keys = tuple(key for key in KEYS if not (polynomial and key in STATE_SPACE_ONLY))
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
    for name in RANGES:
        limits = range_of(written.get("orders", {}).get(name))
        if limits:
            check_ends(limits, source, f"{place}.orders.{name}")


def _orders_of(structure: str | None) -> tuple[str, ...]:
    """The orders of a structure that have ranges; None is any structure of one output."""
    if structure is None:
        return ("nx", "joint")
    if not is_polynomial(structure):
        return ("nx",)
    return ("joint", *(name for name in STRUCTURES[structure] if name != "nk"))


def orders_of_structure(orders: Keys, structure: str | None) -> dict[str, Any]:
    """The orders that a structure has, of those that ``defaults:`` may give for all."""
    return {name: orders[name] for name in orders if name in _orders_of(structure)}


def check_weighting(own: Keys, source: str, place: str) -> None:
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


def check_split(own: Keys, written: Keys, source: str, place: str) -> None:
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


def checked_references(given: Any, role: str, source: str, place: str) -> tuple[Reference, ...]:
    """The channels of one role, each once."""
    references = listed(given)
    if not references and role == "output":
        raise InputError(source, "there is no output", "name one", f"{place}.output")
    twice = next((each for each, count in Counter(references).items() if count > 1), None)
    if twice is not None:
        raise InputError(
            source, f"{twice} stands there twice", "name each channel once", f"{place}.{role}"
        )
    return references


def check_distinct(
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


def check_units(
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


def check_without_input(own: Keys, written: Keys, source: str, place: str) -> None:
    """Refuse keys that need an input."""
    for key in ("input_unit", "delay"):
        if key in written:
            raise InputError(source, "there is no input", "remove the key", f"{place}.{key}")
    if own.get("form", "ss") != "ss":
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
