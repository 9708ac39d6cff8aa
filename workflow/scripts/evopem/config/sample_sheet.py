"""The data sets of a configuration: their names, a table of them, and names with a `*`."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from evopem.config.table import cell, read_table
from evopem.errors import InputError

T = TypeVar("T")

_PATHS = ("file", "validation_file")


@dataclass(frozen=True)
class Origin:
    """Where the user wrote the data sets, for an error to name."""

    source: str  # the configuration, or the table
    templates: Mapping[str, str] = field(default_factory=dict)  # a data set's name with a *
    lines: Mapping[str, int] = field(default_factory=dict)  # of a table
    columns: tuple[str, ...] = ()  # of a table

    def of_name(self, name: str) -> str:
        """Where a data set got its name."""
        return cell(self.lines[name], "name") if self.lines else "datasets"

    def of_key(self, name: str, key: str) -> str:
        """Where a key of a data set stands, or one that it lies below."""
        if not self.lines:
            place = f"datasets.{self.templates.get(name, name)}"
            return f"{place}.{key}" if key else place
        column = key.partition("[")[0]
        while column and column not in self.columns:
            column = column.rpartition(".")[0]
        line = self.lines[name]
        return cell(line, column) if column else f"line {line} ({name})"


def expand(written: Any, source: str) -> tuple[Any, Origin]:
    """Write out every data set of a configuration's ``datasets:``."""
    if isinstance(written, str):
        table = read_table(written)
        return table.entries, Origin(written, lines=table.lines, columns=table.columns)
    if not isinstance(written, Mapping):
        return written, Origin(source)
    datasets: dict[str, Any] = {}
    templates: dict[str, str] = {}
    for name, entry in written.items():
        files = {name: entry}
        if "*" in str(name):
            files = _matching(name, entry, source)
            templates |= dict.fromkeys(files, str(name))
        twin = next((each for each in files if each in datasets), None)
        if twin is not None:
            raise InputError(
                source,
                f"{twin} is also the name of another data set",
                "put a letter or digit before or after the *",
                f"datasets.{name}",
            )
        datasets |= files
    return datasets, Origin(source, templates)


def with_matching_files(datasets: Any, source: str) -> Any:
    """Write out the patterns under ``file`` and ``validation_file``: all files that match."""
    if not isinstance(datasets, Mapping):
        return datasets
    return {
        name: {
            key: _files(value, source, f"datasets.{name}.{key}") if key in _PATHS else value
            for key, value in entry.items()
        }
        if isinstance(entry, Mapping)
        else entry
        for name, entry in datasets.items()
    }


def _files(written: Any, source: str, place: str) -> Any:
    """The files of a pattern in their order, or what was written where it is none."""
    if not isinstance(written, str) or "*" not in written:
        return written
    literally = "*".join(map(glob.escape, written.split("*")))
    found = sorted(glob.glob(literally))  # noqa: PTH207
    if not found:
        raise InputError(source, f"no file matches {written}", "correct the pattern", place)
    return found


def shard_of(datasets: Mapping[str, T], shard: str, source: str) -> dict[str, T]:
    """Take every n-th data set: ``3/40`` is the third and every fortieth after it."""
    number, count = map(int, shard.split("/"))
    if number > count:
        raise InputError(
            source, f"there is no shard {shard}", f"give a number from 1 to {count}", "shard"
        )
    return dict(list(datasets.items())[number - 1 :: count])


def _matching(name: str, entry: Any, source: str) -> dict[str, Any]:
    """Write out one entry for every file that its pattern matches, by what its `*` stands for."""
    place = f"datasets.{name}"
    pattern = entry.get("file") if isinstance(entry, Mapping) else None
    if not isinstance(pattern, str) or pattern.count("*") != 1 or name.count("*") != 1:
        raise InputError(
            source,
            "a name with a * stands for all files of a pattern",
            f"write one * in the name and one in `file`, as in `{name}: {{file: data/*.csv}}`",
            place,
        )
    before, after = pattern.split("*")
    found = {}
    pattern_literally = f"{glob.escape(before)}*{glob.escape(after)}"
    for file in sorted(glob.glob(pattern_literally)):  # noqa: PTH207
        own = file[len(before) : len(file) - len(after)]
        found[name.replace("*", own)] = {
            key: value.replace("*", own) if key in _PATHS and isinstance(value, str) else value
            for key, value in entry.items()
        }
    if not found:
        raise InputError(
            source, f"no file matches {pattern}", "correct the pattern", f"{place}.file"
        )
    return found


RESULTS_FOLDER = "results"

RESERVED_NAMES = (
    "index.html",
    "fleet.csv",
    "fleet_modes.csv",
    "fleet.parquet",
    "logs",
    "benchmarks",
    "checksums",
    "fletcher_powell",
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


def _problem(name: str, folders: dict[str, str]) -> tuple[str, str]:
    """What is wrong with a name and what to do; two empty texts where nothing is."""
    shown = name if len(name) <= 60 else f"{name[:57]}..."
    if len(name) > MAX_LENGTH:
        return (
            f"the data set name {shown!r} has {len(name)} characters",
            f"give it a name of at most {MAX_LENGTH}",
        )
    if name.lower() in RESERVED_NAMES:
        return (
            f"{name} is the name of something else among the results",
            "give the data set another name",
        )
    if not _NAME.fullmatch(name) or ".." in name or name.endswith(".") or _DEVICE.fullmatch(name):
        return (
            f"the data set name {shown!r} cannot be the name of a folder everywhere",
            "use letters, digits, _, - and single dots, a letter or digit first",
        )
    if _PERIODIC.search(name):
        return (
            f"the data set name {shown!r} ends in 20 equal parts, which Snakemake does not accept",
            "shorten the repetition at its end",
        )
    twin = folders.get(name.lower(), name)
    if twin != name:
        return f"{twin} and {name} are one folder where letter case does not count", "rename one"
    return "", ""
