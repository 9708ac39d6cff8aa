"""Many data sets in few words: a table with a row for each recording, and names with a `*`."""

from __future__ import annotations

import csv
import glob
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import yaml

from evopem.errors import InputError

T = TypeVar("T")

_TEXT_COLUMNS = {
    "name",
    "file",
    "validation_file",
    "input_unit",
    "output_unit",
    "time_unit",
    "decimal_mark",
}
_INTEGER = re.compile(r"[+-]?\d+")


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
        return _cell(self.lines[name], "name") if self.lines else "datasets"

    def of_key(self, name: str, key: str) -> str:
        """Where a key of a data set stands, or one that it lies below."""
        if not self.lines:
            place = f"datasets.{self.templates.get(name, name)}"
            return f"{place}.{key}" if key else place
        column = key.partition("[")[0]
        while column and column not in self.columns:
            column = column.rpartition(".")[0]
        line = self.lines[name]
        return _cell(line, column) if column else f"line {line} ({name})"


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
        return _tabulated(written)
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
            key: value.replace("*", own) if key in ("file", "validation_file") else value
            for key, value in entry.items()
        }
    if not found:
        raise InputError(
            source, f"no file matches {pattern}", "correct the pattern", f"{place}.file"
        )
    return found


def _tabulated(table: str) -> tuple[dict[str, Any], Origin]:
    """Read a table of data sets: one column a key, a dot between a key and one below it."""
    header, rows = _rows(table)
    if "name" not in header:
        raise InputError(table, "there is no column name", "add one: each row's folder", "line 1")
    columns = [(index, column, column.split(".")) for index, column in enumerate(header)]
    datasets: dict[str, Any] = {}
    lines: dict[str, int] = {}
    for line, row in rows:
        name = row[header.index("name")].strip()
        if not name:
            raise InputError(table, "there is no name", "name the data set", _cell(line, "name"))
        if name in datasets:
            raise InputError(
                table,
                f"{name} stands here for the second time (first in line {lines[name]})",
                "give every data set a name of its own",
                _cell(line, "name"),
            )
        lines[name] = line
        entry: dict[str, Any] = {}
        datasets[name] = entry
        for index, column, steps in columns:
            text = row[index].strip()
            if text and column != "name":
                _put(entry, steps, _value(column, text, table, line))
    return datasets, Origin(table, lines=lines, columns=tuple(header))


def _rows(table: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Read a table's header and its rows with the numbers of their lines."""
    try:
        with Path(table).open(encoding="utf-8-sig", newline="") as stream:
            first = stream.readline()
            stream.seek(0)
            separator = max(",;\t", key=first.count)
            reader = csv.reader(stream, delimiter=separator, strict=True)
            rows = [(reader.line_num, row) for row in reader if any(map(str.strip, row))]
    except FileNotFoundError:
        raise InputError(
            table, "there is no such table", "correct the path after `datasets:`"
        ) from None
    except OSError as error:
        raise InputError(
            table, f"the table cannot be read ({error.strerror})", "see to it"
        ) from None
    except UnicodeDecodeError as error:
        raise InputError(
            table, f"byte {error.start} is not UTF-8", "save the table as UTF-8"
        ) from None
    except csv.Error as error:
        raise InputError(table, f"this is not a table ({error})", "save it as CSV") from None
    if len(rows) < 2:
        raise InputError(table, "there are no data sets in it", "give a header and a row for each")
    header = [column.strip() for column in rows[0][1]]
    twice = next((column for column in header if header.count(column) > 1), None)
    if twice is not None:
        raise InputError(table, f"two columns are called {twice!r}", "keep one", "line 1")
    for line, row in rows[1:]:
        if len(row) != len(header):
            raise InputError(
                table,
                f"the row has {len(row)} fields and the header {len(header)}",
                "give every row as many fields",
                f"line {line}",
            )
    return header, rows[1:]


def _value(column: str, text: str, table: str, line: int) -> Any:
    """Read a cell: a number, a list in brackets, or text."""
    if column in _TEXT_COLUMNS:
        return text
    if _INTEGER.fullmatch(text):
        return int(text)
    if text.startswith("["):
        try:
            return yaml.safe_load(text)
        except yaml.YAMLError:
            raise InputError(
                table, f"{text} is no list", "write it as [6, 9]", _cell(line, column)
            ) from None
    try:
        return float(text)
    except ValueError:
        return text


def _put(entry: dict[str, Any], steps: list[str], value: Any) -> None:
    for step in steps[:-1]:
        entry = entry.setdefault(step, {})
    entry[steps[-1]] = value


def _cell(line: int, column: str) -> str:
    return f"line {line}, column {column}"
