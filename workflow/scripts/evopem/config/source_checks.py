"""What is refused of the names of data sets, and of their files, channels and units."""

import os
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import NoReturn

from evopem.config.channels import NONE, Reference, is_pattern, listed, of_each
from evopem.config.strict_yaml import Keys
from evopem.config.table import Origin, check_locale
from evopem.errors import InputError

RESULTS_FOLDER = "results"

RESERVED_NAMES = (
    "index.html",
    "fleet.csv",
    "fleet_modes.csv",
    "damage_index.csv",
    "fleet.parquet",
    "logs",
    "benchmarks",
    "checksums",
    "fletcher_powell",
    "setups",
)
"""Names of other files and folders of the results."""

MAX_LENGTH = 100
"""Most characters of a name: file systems take 255 bytes, and Snakemake's own names add to it."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
# Snakemake takes a wildcard that ends like this for an endless recursion of rules.
_PERIODIC = re.compile(r"(.+?)\1{19}$")


def check_names(names: Iterable[str], origin: Origin) -> None:
    """Refuse names that cannot be folders on every file system, or wildcards of Snakemake."""
    folders: dict[str, str] = {}
    for name in names:
        problem, remedy = _problem(name, folders)
        if problem:
            raise InputError(origin.source, problem, remedy, origin.of_name(name))
        folders[name.lower()] = name


def is_valid(name: str) -> bool:
    """Whether a text can be the name of a data set, beside no others."""
    return not _problem(name, {})[0]


def _problem(name: str, folders: Mapping[str, str]) -> tuple[str, str]:
    """What is wrong with a name and what to do; two empty texts where nothing is."""
    shown = repr(name if len(name) <= 60 else f"{name[:57]}...")
    twin = folders.get(name.lower(), name)
    if len(name) > MAX_LENGTH:
        problem = f"the data set name {shown} has {len(name)} characters"
        return problem, f"give it a name of at most {MAX_LENGTH}"
    if name.lower() in RESERVED_NAMES:
        return f"{name} is the name of something else among the results", "give another name"
    if not _NAME.fullmatch(name) or ".." in name or name.endswith(".") or _DEVICE.fullmatch(name):
        problem = f"the data set name {shown} cannot be the name of a folder everywhere"
        return problem, "use letters, digits, _, - and single dots, a letter or digit first"
    if _PERIODIC.search(name):
        problem = f"the data set name {shown} ends in 20 equal parts: Snakemake refuses it"
        return problem, "shorten the repetition at its end"
    if twin != name:
        return f"{twin} and {name} are one folder where letter case does not count", "rename one"
    return "", ""


@dataclass(frozen=True)
class Place:
    """The keys of a data set in the configuration, and those that ``defaults:`` gave it."""

    source: str
    name: str
    inherited: Collection[str] = ()

    def refuse(self, key: str, problem: str, remedy: str) -> NoReturn:
        """Say what is wrong with a key below the place; an empty one is the place itself."""
        raise InputError(self.source, problem, remedy, self.of_key(key))

    def of_key(self, key: str) -> str:
        """Where a key stands."""
        above = [key, *(key.rsplit(".", count)[0] for count in range(1, key.count(".") + 1))]
        name = "defaults" if key and any(p in self.inherited for p in above) else self.name
        return f"{name}.{key}".rstrip(".")


def check_source(
    keys: Keys, inputs: tuple[Reference, ...], outputs: tuple[Reference, ...], at: Place
) -> None:
    """Refuse channels in two roles, units of other channels, and paths that cannot be."""
    roles = {"input": inputs, "time": listed(keys.get("time")), "output": outputs}
    if outputs in ((), (NONE,)):
        at.refuse("output", "there is no output", "name a channel")
    if "frequency" in keys and len(_paths(keys)) > 1:
        at.refuse("file", "frequency responses are read from one file", "give one file")
    if "frequency" in keys and keys.get("recipe") == "chapter":
        at.refuse("recipe", "the chapter's recipe needs samples in time", "remove the key")
    if "time" in keys and "sampling_rate" in keys:
        at.refuse("", "both sampling_rate and time are given", "give one of the two")
    for role, channels in roles.items():
        for channel, count in Counter(channels).items():
            if count > 1:
                at.refuse(role, f"{channel} stands there twice", "name each channel once")
    for first, second in combinations(roles, 2):
        for channel in roles[second]:
            # A frequency response may be that of the place which is driven.
            if channel in roles[first] and "frequency" not in keys:
                problem = f"{channel} is both {first} and {second}"
                at.refuse(second, problem, "name two different columns")
    for role in ("input", "output"):
        units, key = keys.get(f"{role}_unit"), f"{role}_unit"
        if isinstance(units, tuple) and not any(map(is_pattern, roles[role])):
            of_each(units, tuple(map(str, roles[role])), at.source, at.of_key(key), role)
    for path, key in _paths(keys):
        if {"{", "}"} & set(path):
            problem = f"the braces in {path} have a meaning of their own in a workflow"
            at.refuse(key, problem, "rename the file")
        if "\n" in path or "\r" in path:
            at.refuse(key, f"there is a line break in {path!r}", "remove it")
        check_locale(path, at.source, f"{at.name}.{key}")


def _paths(keys: Keys) -> list[tuple[str, str]]:
    return [(path, key) for key in ("file", "validation_file") for path in listed(keys.get(key))]


def check_no_results(datasets: Mapping[str, Keys], source: str) -> None:
    """Refuse a recorded file that lies among the results, or is its own validation file.

    A result of any data set is refused, not of the same one alone: Snakemake deletes the outputs of
    a job before it runs, and would run the data sets one after the other, or in a circle.
    """
    results = os.path.realpath(RESULTS_FOLDER)
    folders = {name.lower() for name in (*datasets, *RESERVED_NAMES)}
    for name, keys in datasets.items():
        at, known = Place(source, f"datasets.{name}"), dict[object, tuple[int, str, str]]()
        for number, (path, key) in enumerate(_paths(keys)):
            real_path = os.path.realpath(path)
            inside = Path(os.path.relpath(real_path, results)).parts
            if not inside or inside[0].lower() in folders:
                problem = f"{path} is a result of this workflow"
                at.refuse(key, problem, "copy it to a folder of recordings and name the copy")
            for identity in filter(None, (real_path, _identity(path))):
                first, earlier, role = known.setdefault(identity, (number, path, key))
                alias = "" if earlier == path else f" ({earlier})"
                if first != number and role == key:
                    problem = f"{path} stands there twice{alias}"
                    at.refuse(key, problem, "give every recording once")
                if first != number:
                    problem = f"{path} is also the estimation file{alias}"
                    remedy = "give an independent recording, or leave the key out to cut this one"
                    at.refuse(key, problem, remedy)


def _identity(path: str) -> tuple[int, int] | None:
    """What all paths to one file have in common, hard links too; None where there is no file."""
    with suppress(OSError, ValueError):
        status = os.stat(path)  # noqa: PTH116
        return status.st_dev, status.st_ino
    return None
