"""The keys of a model's structure and orders: checked, and in one form."""

from __future__ import annotations

from typing import Any

from evopem.config.strict_yaml import Keys
from evopem.config.structures import STRUCTURES, has_input, phases_of
from evopem.errors import InputError

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
