"""What no single key shows: keys of a data set that contradict each other, each in one sentence."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from evopem.config.channels import Reference, is_pattern
from evopem.config.dataset_names import RESERVED_NAMES, RESULTS_FOLDER
from evopem.config.keys import (
    ANALYSIS,
    NONE,
    SOURCE,
    STATE_SPACE,
    SYNTHESIS,
    input_ranges_of,
    listed,
)
from evopem.config.schema import ALL_SAMPLES
from evopem.config.settings import DatasetSettings, SearchSettings
from evopem.config.strict_yaml import Keys
from evopem.config.structures import (
    AUTOMATIC_STRUCTURES,
    STRUCTURES,
    has_input,
    is_fitted_for,
    is_polynomial,
    phases_of,
)
from evopem.config.table import check_locale
from evopem.config.yaml_form import (
    CHANNEL_SEARCH,
    GAINS,
    OF_INPUTS,
    STATE_SPACE_KEYS,
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
}
_NOT_OF_SEVERAL = ("synthesis", "seed", "samples", "noise", "transforms", "spectrum", "level")
# Constraints of one input that models with several do not have, and why.
_NO_CONSTRAINTS = {
    "fixed_coefficients": "orders and delays of each input follow from the recording, and with them"
    " what a coefficient stands for",
    "priors": "they are for one input and one output",
}


@dataclass(frozen=True)
class Place:
    """The keys of a data set, or of ``defaults:``, in the configuration."""

    source: str
    name: str

    def refuse(self, key: str, problem: str, remedy: str) -> NoReturn:
        """Say what is wrong with a key below the place; an empty one is the place itself."""
        raise InputError(self.source, problem, remedy, f"{self.name}.{key}".rstrip("."))


def check_source(keys: Keys, at: Place) -> None:
    """Refuse no or two sources, keys of another kind of source, and channels in two roles."""
    kinds = [key for key in ("file", "synthesis") if key in keys]
    if len(kinds) != 1:
        found = "are both given" if kinds else "are both missing"
        at.refuse("", f"file and synthesis {found}", "give exactly one of the two")
    known = {*SOURCE} if kinds == ["file"] else {*SYNTHESIS}
    of_arm = keys.get("synthesis") == "flexible_arm"
    for key in keys:
        if key not in ANALYSIS and (key not in known or (of_arm and key == "noise")):
            other = "a synthetic" if kinds == ["file"] else "a recorded"
            other = "an armax" if of_arm and key == "noise" else other
            kind = f"`{kinds[0]}: {keys[kinds[0]]}`"
            at.refuse(
                key, f"the key belongs to {other} data set, and this one has {kind}", "remove it"
            )
    if kinds == ["file"]:
        if "time" in keys and "sampling_rate" in keys:
            at.refuse("", "both sampling_rate and time are given", "give one of the two")
        _check_paths_can_be(keys, at)
        _check_channels(keys, at)


def _check_channels(keys: Keys, at: Place) -> None:
    """Refuse no output, a channel twice or in two roles, and units of other channels."""
    inputs, outputs = channels_of(keys)
    roles = {"input": inputs, "output": outputs, "time": listed(keys.get("time"))}
    if not outputs:
        at.refuse("output", "there is no output", "name a channel")
    for role, channels in roles.items():
        for channel, count in Counter(channels).items():
            if count > 1:
                at.refuse(role, f"{channel} stands there twice", "name each channel once")
    for one, other in (("input", "output"), ("time", "input"), ("time", "output")):
        for channel in roles[other]:
            if channel in roles[one]:
                problem = f"{channel} is both {one} and {other}"
                at.refuse(other, problem, "name two different columns")
    for role in ("input", "output"):
        units, channels = keys.get(f"{role}_unit", ""), roles[role]
        patterns = any(map(is_pattern, channels))
        if isinstance(units, tuple) and not patterns and len(units) != len(channels):
            at.refuse(
                f"{role}_unit",
                f"there are {len(units)} units and {len(channels)} {role}s",
                "give one unit for each, one for all, or a mapping by their names",
            )


def _paths(keys: Keys) -> list[tuple[str, str]]:
    return [(path, key) for key in ("file", "validation_file") for path in listed(keys.get(key))]


def _check_paths_can_be(keys: Keys, at: Place) -> None:
    for path, key in _paths(keys):
        if {"{", "}"} & set(path):
            problem = f"the braces in {path} have a meaning of their own in a workflow"
            at.refuse(key, problem, "rename the file")
        if "\n" in path or "\r" in path:
            at.refuse(key, f"there is a line break in {path!r}", "remove it")
        check_locale(path, at.source, f"{at.name}.{key}")


def check_no_results(datasets: Mapping[str, Keys], source: str) -> None:
    """Refuse a recorded file that lies among the results, or is its own validation file.

    A result of any data set is refused, not of the same one alone: Snakemake deletes the outputs of
    a job before it runs, and would run the data sets one after the other, or in a circle.
    """
    real_path = _RealPaths()
    results = os.path.realpath(RESULTS_FOLDER)
    folders = {name.lower() for name in (*datasets, *RESERVED_NAMES)}
    for name, keys in datasets.items():
        at, paths = Place(source, f"datasets.{name}"), _paths(keys)
        for path, key in paths:
            inside = Path(os.path.relpath(real_path(path), results)).parts
            if not inside or inside[0].lower() in folders:
                problem = f"{path} is a result of this workflow"
                at.refuse(key, problem, "copy it to a folder of recordings and name the copy")
        if len(paths) > 1:
            _check_each_once(paths, real_path, at)


def _check_each_once(paths: list[tuple[str, str]], real_path: _RealPaths, at: Place) -> None:
    """Refuse a file that is two recordings of a data set, under whatever names."""
    known: dict[object, tuple[str, str]] = {}
    for path, key in paths:
        for identity in filter(None, (real_path(path), _identity(path))):
            if identity not in known:
                known[identity] = (path, key)
                continue
            earlier, earlier_key = known[identity]
            alias = "" if earlier == path else f" ({earlier})"
            if earlier_key == key:
                at.refuse(key, f"{path} stands there twice{alias}", "give every recording once")
            at.refuse(
                key,
                f"{path} is also the estimation file{alias}",
                "give an independent recording, or leave the key out to cut this one",
            )


def _identity(path: str) -> tuple[int, int] | None:
    """What all paths to one file have in common, hard links too; None where there is no file."""
    try:
        found = os.stat(path)  # noqa: PTH116
    except (OSError, ValueError):
        return None
    return found.st_dev, found.st_ino


class _RealPaths:
    """The paths of files without links and dots, quick for many files in one folder."""

    def __init__(self) -> None:
        self.folders: dict[str, str] = {}

    def __call__(self, path: str) -> str:
        folder, name = os.path.split(path)
        if name in ("", ".", ".."):
            return os.path.realpath(path)
        if folder not in self.folders:
            self.folders[folder] = os.path.realpath(folder)
        inside = os.path.join(self.folders[folder], name)  # noqa: PTH118
        return os.path.realpath(inside) if os.path.islink(inside) else inside  # noqa: PTH114


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
    inputs, outputs = channels_of(written)
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
    foreign = [key for key in STATE_SPACE_KEYS if key in written]
    for key, channels in (("input_unit", inputs), ("output_unit", outputs)):
        if not isinstance(of_one_input(written.get(key, ""), channels), str):
            foreign.append(key)
    foreign += ["orders.nf"] if "nf" in written.get("orders", {}) else []
    if foreign:
        at.refuse(
            foreign[0],
            "the key belongs to a data set with several channels",
            f"write structure: {STATE_SPACE}, or remove it",
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
    structure = keys.get("structure")
    inputs, _ = channels_of(written)
    _check_structure(structure, written, at)
    _check_keys_of_several(structure, written, at)
    if keys.get("search", {}).get("objective") == "absolute" and (
        keys.get("weighting") == "determinant"
    ):
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
    """Refuse ranges of other inputs; what is given by name waits for the recording where inputs are
    numbers or patterns."""
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
