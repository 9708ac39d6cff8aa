"""What no single key shows: keys of a data set that contradict each other, each in one sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from evopem.config.channels import Reference, is_pattern
from evopem.config.keys import (
    ANALYSIS,
    NONE,
    SOURCE,
    STATE_SPACE,
    input_ranges_of,
    listed,
)
from evopem.config.schema import ALL_SAMPLES
from evopem.config.settings import DatasetSettings, SearchSettings
from evopem.config.source_checks import Place
from evopem.config.strict_yaml import Keys
from evopem.config.structures import (
    AUTOMATIC_STRUCTURES,
    STRUCTURES,
    has_input,
    is_fitted_for,
    is_polynomial,
    phases_of,
)
from evopem.config.yaml_form import (
    CHANNEL_SEARCH,
    GAINS,
    OF_INPUTS,
    channels_of,
    of_one_input,
)
from evopem.errors import InputError

# Why a structure does not search an order.
_REASONS = {
    "joint": "its only order is nb",
    "nc": "it has no polynomial C",
    "nd": "it has no polynomial D",
    "na": "it has no polynomial A",
    "nb": "it has no input",
    "nf": "the degree of its F, where it has one, is the order k",
}
_NOT_OF_SEVERAL = ("synthesis", "seed", "samples", "noise", "transforms", "spectrum", "level")
# Constraints of one input that models with several do not have, and why.
_NO_CONSTRAINTS = {
    "fixed_coefficients": "orders and delays of each input follow from the recording, and with them"
    " what a coefficient stands for",
    "priors": "they are for one input and one output",
}


def check_analysis(written: Keys, keys: Keys, at: Place) -> None:
    """Refuse exchanged ends of ranges, numbers of samples that are none, and sizes of the search.

    `written` decides which of two keys in a conflict an error names: one of this part of the file.
    """
    for group in ("delay", "orders"):
        for key, value in keys.get(group, {}).items():
            ranges = (value,) if value == "auto" else _all_ranges(value)
            for each in ranges:
                if each != "auto" and each[0] > each[1]:
                    problem = f"the lower end of {list(each)} is above the upper one"
                    at.refuse(f"{group}.{key}", problem, f"write [{each[1]}, {each[0]}]")
    for key in ("discard", "estimation"):
        value = keys.get("split", {}).get(key)
        if isinstance(value, float) and value > 1:
            at.refuse(
                f"split.{key}",
                f"{value} is neither a whole number nor a fraction",
                "give a whole number of samples or a fraction between 0 and 1",
            )
    built_in, own = SearchSettings(), written.get("search", {})
    sizes = {"mu": built_in.mu, "nu": built_in.nu, "lambda": built_in.lambda_}
    sizes |= {key: each for key, each in keys.get("search", {}).items() if key in sizes}
    for low, meaning in (
        ("mu", "as many offspring as parents are needed"),
        ("nu", "no more individuals can be improved than there are offspring"),
    ):
        if sizes[low] > sizes["lambda"]:
            key = low if low in own or "lambda" not in own else "lambda"
            at.refuse(
                f"search.{key}",
                f"{low} is {sizes[low]} and lambda is {sizes['lambda']}, but {meaning}",
                f"give {low} no more than lambda",
            )


def _all_ranges(value: Any) -> tuple[Any, ...]:
    ranges = input_ranges_of(value)
    return (*((ranges.all,) if ranges.all else ()), *ranges.in_order, *ranges.by_name.values())


def check_something_left(keys: Keys, at: Place) -> None:
    """Refuse to estimate on all samples of a recording that is also to be validated on."""
    estimation = keys.get("split", {}).get("estimation")
    takes_all = isinstance(estimation, float) and estimation == ALL_SAMPLES
    if takes_all and "validation_file" not in keys:
        at.refuse(
            "split.estimation",
            f"{estimation} takes all samples, so none are left to validate on",
            "give a smaller fraction such as 0.8, or a validation_file",
        )


def check_orders_of(structure: str, written: Keys, at: Place) -> None:
    """Refuse keys of orders, or of an input, that a structure does not have."""
    phases = phases_of(structure)
    for key in written.get("orders", {}):
        if key not in phases:
            reason = _REASONS[key]
            if key == "na" and "na" in STRUCTURES[structure]:
                reason = "the degree of its A is the order k"
            at.refuse(
                f"orders.{key}",
                f"structure {structure} has no such search: {reason}",
                f"remove it, or give one of {', '.join(p for p in phases if p != 'delay')}",
            )
    if has_input(structure):
        return
    for key in ("delay", "input", "input_unit"):
        if key in written and written[key] != NONE:
            at.refuse(key, f"structure {structure} has no input", "remove the key")


def check_one_channel(written: Keys, at: Place) -> None:
    """Refuse keys of several channels in a data set with one input and one output."""
    inputs, _ = channels_of(written)
    for key in GAINS:
        value = of_one_input(written.get("constraints", {}).get(key), inputs)
        if isinstance(value, Mapping):
            at.refuse(
                f"constraints.{key}",
                "a mapping from inputs belongs to a data set with several",
                "write the value alone",
            )
    for group, key in OF_INPUTS:
        value = of_one_input(written.get(group, {}).get(key), inputs)
        if value is not None and not input_ranges_of(value).all:
            at.refuse(
                f"{group}.{key}",
                "one input has one range of it",
                "give two whole numbers, [lower, upper], or one of them",
            )


def check_chapter(written: Keys, keys: Keys, at: Place) -> None:
    """Refuse keys that the chapter's recipe does not have."""
    if "purpose" in written:
        remedy = "remove the key, or write recipe: auto"
        at.refuse("purpose", "the chapter's recipe knows no purpose", remedy)
    structure = keys.get("structure", "armax")
    check_orders_of(structure, written, at)
    if not has_input(structure) and keys.get("transforms", {}).get("difference_input"):
        problem = f"structure {structure} has no input to difference"
        at.refuse("transforms.difference_input", problem, "set it to 0")


def check_automatic(written: Keys, at: Place) -> None:
    """Refuse keys that the automatic recipe does not have."""
    structure = written.get("structure")
    if structure is not None and structure not in AUTOMATIC_STRUCTURES:
        problem = (
            f"the automatic recipe does not search structure {structure}"
            if has_input(structure)
            else f"structure {structure} has no input, and the automatic recipe needs one"
        )
        known = ", ".join(AUTOMATIC_STRUCTURES)
        at.refuse("structure", problem, f"write recipe: chapter, or one of {known}")
    if written.get("level") is False:
        remedy = "remove the key, or write recipe: chapter"
        at.refuse("level", "the automatic recipe always estimates a level", remedy)
    for group, known_keys in (("orders", ("joint", "nc", "nd", "nb")), ("delay", ("nk",))):
        for key in written.get(group, {}):
            if key not in known_keys:
                at.refuse(
                    f"{group}.{key}",
                    "the automatic recipe has no such range",
                    f"remove it, give one of {', '.join(known_keys)}, or write recipe: chapter",
                )
    if structure is not None:
        check_orders_of(structure, written, at)


def check_several_channels(written: Keys, keys: Keys, at: Place) -> None:
    """Refuse keys that a data set with several channels does not have."""
    if "file" not in written:
        at.refuse("", "a synthetic data set has one input and one output", "give a file")
    structure, (inputs, _) = keys.get("structure"), channels_of(written)
    _check_structure(structure, written, at)
    _check_keys_of_several(structure, written, at)
    absolute = keys.get("search", {}).get("objective") == "absolute"
    if absolute and keys.get("weighting") == "determinant":
        at.refuse(
            "weighting",
            "absolute errors have no covariance whose determinant could be taken",
            "write weighting: noise or power, or search.objective: quadratic",
        )
    _check_focus(written, keys, at)
    _check_input_ranges(keys, inputs, at)
    _check_constraints(structure, written, inputs, at)
    if not inputs:
        _check_without_input(written, keys, at)
    if "geometry" in keys:
        _check_geometry(keys["geometry"], at)


def _check_structure(structure: str | None, written: Keys, at: Place) -> None:
    """Refuse a structure that does not have the channels, and the chapter's recipe."""
    inputs, outputs = listed(written.get("input", 1)), listed(written.get("output", 2))
    where = "" if "structure" in written else " (from defaults)"
    if structure is not None and is_polynomial(structure):
        if len(outputs) > 1 or any(map(is_pattern, outputs)):
            at.refuse(
                "output",
                f"there is a list of outputs, and structure {structure}{where} has one output",
                f"write structure: {STATE_SPACE}, or name one channel",
            )
        if not has_input(structure):
            at.refuse(
                "structure",
                f"there is a list of channels, and structure {structure}{where} has no input",
                f"write structure: {STATE_SPACE}, or name one output and no input",
            )
        if not inputs:
            at.refuse(
                "input",
                f"structure {structure}{where} needs an input, and there is none",
                f"write structure: {STATE_SPACE}, or name an input",
            )
    if written.get("recipe") == "chapter":
        at.refuse(
            "recipe",
            "the chapter's recipe has one input and one output",
            "remove the key: models of several channels are found by recipe auto",
        )


def orders_of(structure: str | None) -> tuple[str, ...]:
    """The orders of models of several channels that have ranges; None is any structure."""
    if structure is None:
        return ("nx", "joint")
    if not is_polynomial(structure):
        return ("nx",)
    return ("joint", *(name for name in STRUCTURES[structure] if name != "nk"))


def _check_keys_of_several(structure: str | None, written: Keys, at: Place) -> None:
    polynomial = structure is not None and is_polynomial(structure)
    outputs = listed(written.get("output", 2))
    orders = orders_of(structure)
    if structure is None and (len(outputs) > 1 or is_pattern(outputs[0])):
        orders = ("nx",)
    known = tuple(
        key
        for key in (*SOURCE, *ANALYSIS)
        if key not in _NOT_OF_SEVERAL and not (polynomial and key in ("form", "weighting"))
    )
    groups = {"orders": orders, "delay": ("nk",), "search": CHANNEL_SEARCH}
    paths = [(key, known, key) for key in written]
    for group, names in groups.items():
        paths += [(key, names, f"{group}.{key}") for key in written.get(group, {})]
    for key, names, path in paths:
        if key not in names:
            called = "a data set with several channels"
            if structure is not None:
                called = f"structure {structure}" + (" with several inputs" if polynomial else "")
            remedy = f"remove it, or give one of {', '.join(names)}"
            at.refuse(path, f"{called} has no such key", remedy)


def _check_focus(written: Keys, keys: Keys, at: Place) -> None:
    """Refuse a focus that no form which is written is fitted for."""
    focus = written.get("focus")
    if focus is None:
        return
    if focus not in ("prediction", "simulation"):
        problem = f"errors {focus} samples ahead are for one input and one output"
        at.refuse("focus", problem, "write prediction or simulation")
    if focus == "simulation" and written.get("input") == NONE:
        problem = "without an input there is nothing to simulate"
        at.refuse("focus", problem, "write prediction, or remove the key")
    form = keys.get("form", keys.get("structure"))
    white = focus == "prediction" and form in ("oe", "fir")  # then both are the same
    if form in (None, STATE_SPACE) or white or is_fitted_for(form, focus):
        return
    better = "oe" if is_polynomial(form) else "ss_oe" if focus == "simulation" else "ss"
    other = "prediction" if focus == "simulation" else "simulation"
    key = "form" if "form" in keys else "structure"
    at.refuse("focus", f"{form} is fitted for {other}", f"write {key}: {better}, or another focus")


def _check_input_ranges(keys: Keys, inputs: Sequence[Reference], at: Place) -> None:
    """Refuse ranges of other inputs, as far as these are known by name before the recording is."""
    if any(map(is_pattern, inputs)):
        return
    by_name = all(isinstance(each, str) for each in inputs)
    for group, key in OF_INPUTS:
        if key in keys.get(group, {}):
            ranges = input_ranges_of(keys[group][key])
            if by_name or not ranges.by_name:
                try:
                    ranges.of_inputs(tuple(map(str, inputs)))
                except InputError as error:
                    at.refuse(f"{group}.{key}", error.problem, error.remedy)


def _check_constraints(
    structure: str | None, written: Keys, inputs: Sequence[Reference], at: Place
) -> None:
    """Refuse constraints that a model of several channels does not have."""
    constraints = written.get("constraints")
    if constraints is None:
        return
    polynomial = structure is not None and is_polynomial(structure)
    if not polynomial and written.get("form") in (None, "ss_bj"):
        at.refuse(
            "constraints",
            "what constraints mean depends on the structure: of ss_bj it is not said whether"
            " poles of the plant or of its noise model are meant",
            "write form: ss_oe or ss, or a polynomial structure such as oe",
        )
    for key, reason in _NO_CONSTRAINTS.items():
        if constraints.get(key):
            at.refuse(f"constraints.{key}", f"several inputs do not have it: {reason}", "remove it")
    if constraints.get("stability") == "free":
        remedy = "remove the key, or identify one input alone"
        at.refuse("constraints.stability", "models with several inputs are stable", remedy)
    named = [each for each in inputs if isinstance(each, str) and not is_pattern(each)]
    for key in GAINS:
        gains = constraints.get(key, {})
        if not isinstance(gains, Mapping):
            at.refuse(
                f"constraints.{key}",
                "there are several inputs, each with a gain of its own",
                "write a mapping from their names, such as {hot: 2.0}",
            )
        unknown = [name for name in gains if name not in named]
        if unknown and len(named) == len(inputs):
            remedy = f"name one of {', '.join(named)}"
            at.refuse(f"constraints.{key}", f"there is no input {unknown[0]}", remedy)


def _check_without_input(written: Keys, keys: Keys, at: Place) -> None:
    """Refuse keys that need an input."""
    for key in ("input_unit", "delay"):
        if key in written:
            at.refuse(key, "there is no input", "remove the key")
    if keys.get("form", "ss") != "ss":
        problem = f"form {keys['form']} has a plant that inputs drive"
        at.refuse("form", problem, "write ss, or remove the key")
    if keys.get("purpose") == "simulation":
        problem = "without an input there is nothing to simulate"
        at.refuse("purpose", problem, "write prediction, modes or auto")


def _check_geometry(geometry: Keys, at: Place) -> None:
    """Refuse lines and channels at points that do not exist, and directions of no length."""
    points = geometry["points"]
    ends = [
        (end, f"lines[{index}]")
        for index, line in enumerate(geometry.get("lines", ()))
        for end in line
    ]
    ends += [(each["point"], f"channels.{name}") for name, each in geometry["channels"].items()]
    for point, key in ends:
        if point not in points:
            remedy = f"give one of {', '.join(list(points)[:20])}"
            at.refuse(f"geometry.{key}", f"there is no point {point}", remedy)
    for name, channel in geometry["channels"].items():
        if not any(channel["direction"]):
            at.refuse(
                f"geometry.channels.{name}.direction",
                "the direction has no length",
                "give three numbers, not all 0, or one of x, y, z, -x, -y, -z",
            )


def check_several_recordings(settings: DatasetSettings, at: Place) -> None:
    """Refuse keys that have no meaning for several recordings of one data set."""
    recordings = len(settings.source.all_files) - len(settings.source.validation_files)
    if recordings <= 1:
        return
    split = settings.preparation.split
    whole_recordings = split.by == "recordings" and not settings.source.validation_files
    if whole_recordings and isinstance(split.estimation, int):
        at.refuse(
            "split.estimation",
            f"{split.estimation} is a number of samples, and whole recordings are held out",
            "give a fraction between 0 and 1, or write by: samples beside it to cut each recording",
        )
    if settings.is_single_channel and settings.fit.changes_model:
        at.refuse(
            "constraints" if settings.fit.constraints else "focus",
            f"the key is for a data set of one recording, and this one has {recordings}",
            "remove the key, or give one file",
        )
