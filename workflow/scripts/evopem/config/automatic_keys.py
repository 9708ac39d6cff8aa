"""The keys of the automatic recipe: what is written decides, what is missing is decided."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evopem.config.settings import (
    AutomaticSettings,
    DatasetSettings,
    SearchSettings,
    SpectrumSettings,
)
from evopem.config.strict_yaml import Keys
from evopem.config.structures import AUTOMATIC_STRUCTURES, has_input
from evopem.errors import InputError
from evopem.files.json_form import to_json

# Poles this close to the unit circle act as integrators in any record.
MAX_ROOT_RADIUS = 1.0 - 1e-7
_ORDERS = ("joint", "nc", "nd", "nb")
_DIFFERENCES = ("difference", "difference_input")


def built_in_keys() -> dict[str, Any]:
    """The keys of an automatic recipe that have built-in values."""
    search = to_json(SearchSettings(max_root_radius=MAX_ROOT_RADIUS))
    del search["objective"]
    return {
        "recipe": "auto",
        "purpose": "auto",
        "transforms": {},
        "split": {"estimation": 0.8},
        "spectrum": to_json(SpectrumSettings()),
        "search": search,
    }


NO_TRANSFORMS = {"box_cox": "none", "difference": 0, "difference_input": 0}
"""What the recording is until its own transforms are decided."""


def laid_over(lower: Keys, upper: Keys) -> dict[str, Any]:
    """Lay one mapping over another, keeping the keys of both."""
    merged = dict(lower)
    for key, value in upper.items():
        below = merged.get(key)
        if isinstance(value, Mapping) and isinstance(below, Mapping):
            merged[key] = laid_over(below, value)
        else:
            merged[key] = value
    return merged


def check_automatic_keys(written: Keys, source: str, place: str) -> None:
    """Refuse keys that the automatic recipe does not have.

    Raises
    ------
    InputError
    """
    structure = written.get("structure")
    if structure is not None and structure not in AUTOMATIC_STRUCTURES:
        problem = (
            f"the automatic recipe does not search structure {structure}"
            if has_input(structure)
            else f"structure {structure} has no input, and the automatic recipe needs one"
        )
        raise InputError(
            source,
            problem,
            f"write recipe: chapter, or one of {', '.join(AUTOMATIC_STRUCTURES)}",
            f"{place}.structure",
        )
    if written.get("level") is False:
        raise InputError(
            source,
            "the automatic recipe always estimates a level",
            "remove the key, or write recipe: chapter",
            f"{place}.level",
        )
    for group, known in (("orders", _ORDERS), ("delay", ("nk",))):
        for key in written.get(group, {}):
            if key not in known:
                raise InputError(
                    source,
                    "the automatic recipe has no such range",
                    f"remove it, give one of {', '.join(known)}, or write recipe: chapter",
                    f"{place}.{group}.{key}",
                )


def automatic_content(keys: Keys) -> dict[str, Any]:
    """The content of :class:`.AutomaticSettings` of complete keys."""
    orders = keys.get("orders", {})
    limits = {name: orders[name] for name in _ORDERS if orders.get(name, "auto") != "auto"}
    if "nb" in limits:
        limits["nb"] = {"all": limits["nb"]}
    if "nk" in keys.get("delay", {}):
        limits["nk"] = {"all": keys["delay"]["nk"]}
    # Constraints are those of the model after the transforms, which must then be known.
    known = "constraints" in keys
    transforms = set(keys.get("transforms", {}))
    return {
        "purpose": keys["purpose"],
        "structure": keys.get("structure"),
        "orders": limits,
        "start_given": "discard" in keys["split"],
        "rate_given": "resample" in keys,
        "objective": keys["search"].get("objective"),
        "box_cox_given": known or "box_cox" in transforms,
        "differences_given": known or bool(transforms.intersection(_DIFFERENCES)),
    }


def automatic_keys(settings: DatasetSettings, automatic: AutomaticSettings) -> dict[str, Any]:
    """The keys that give these settings; what is decided from the recording is left out."""
    preparation = to_json(settings.preparation)
    split, search = dict(preparation["split"]), to_json(settings.search)
    if not automatic.start_given:
        del split["discard"]
    if automatic.objective is None:
        del search["objective"]
    keys: dict[str, Any] = {"recipe": "auto", "purpose": automatic.purpose}
    if automatic.rate_given:
        keys["resample"] = preparation["resample"] or "none"
    transforms = dict(preparation["transforms"])
    if not automatic.box_cox_given:
        del transforms["box_cox"]
    if not automatic.differences_given:
        transforms = {name: transforms[name] for name in transforms if name not in _DIFFERENCES}
    keys |= {"transforms": transforms} if transforms else {}
    keys["split"] = split
    keys["spectrum"] = to_json(settings.spectrum)
    if automatic.structure is not None:
        keys["structure"] = automatic.structure
    orders = automatic.orders
    if orders.nk.all is not None:
        keys["delay"] = {"nk": list(orders.nk.all)}
    limits = {"joint": orders.joint, "nc": orders.nc, "nd": orders.nd, "nb": orders.nb.all}
    given = {name: list(limit) for name, limit in limits.items() if limit is not None}
    return keys | ({"orders": given} if given else {}) | {"search": search}
