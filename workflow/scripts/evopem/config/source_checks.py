"""What is refused of the source of a data set: its files, its channels and their units."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from evopem.config.channels import is_pattern
from evopem.config.keys import ANALYSIS, SOURCE, SYNTHESIS, listed
from evopem.config.sample_sheet import RESERVED_NAMES, RESULTS_FOLDER
from evopem.config.strict_yaml import Keys
from evopem.config.table import check_locale
from evopem.config.yaml_form import channels_of
from evopem.errors import InputError


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
