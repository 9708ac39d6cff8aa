"""Many data sets in few words: a table with a row for each recording, and names with a `*`."""

from __future__ import annotations

import glob
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from evopem.config.table import cell, read_table
from evopem.errors import InputError

T = TypeVar("T")

_PATHS = ("file", "validation_file")


@dataclass(frozen=True)
class Origin:
    """Where the user wrote the data sets, for an error to name.

    Attributes
    ----------
    source : str
        The configuration, or the table.
    templates : mapping
        The name with a `*` behind a data set's own.
    lines : mapping
        A table's line for each data set; empty where there is no table.
    columns : tuple of str
        The table's columns.
    """

    source: str
    templates: Mapping[str, str] = field(default_factory=dict)
    lines: Mapping[str, int] = field(default_factory=dict)
    columns: tuple[str, ...] = ()

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
    """Write out every data set of a configuration's ``datasets:``.

    Parameters
    ----------
    written : mapping, str or anything
        Entries by name, of which one with a `*` stands for all files that its ``file`` matches; or
        the path of a table. Anything else comes back as it is, for the schema to refuse.
    source : str
        What the configuration is called in an error.

    Returns
    -------
    datasets : mapping or anything
        The entries by name, none of them with a `*`.
    origin : Origin
        Where they stand.

    Raises
    ------
    InputError
        For a table that cannot be read, or a pattern that no file or too many names match.
    """
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
    """Write out the patterns under ``file`` and ``validation_file``: all files that match.

    Parameters
    ----------
    datasets : mapping or anything
        Entries by name. Anything else comes back as it is, for the schema to refuse.
    source : str
        What the configuration is called in an error.

    Raises
    ------
    InputError
        For a pattern that no file matches.
    """
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
    """Take every n-th data set: ``3/40`` is the third and every fortieth after it.

    Raises
    ------
    InputError
        When there is no such shard.
    """
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
