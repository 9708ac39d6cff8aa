"""A table of data sets: one row for each recording, one column for each key.

Tables come from spreadsheets and from pandas, R or MATLAB: with commas, semicolons or tabs, in
UTF-8 or UTF-16, with row numbers in a column without a name, with empty rows and columns at the
end, and with decimal commas where semicolons separate the columns.
"""

from __future__ import annotations

import codecs
import csv
import glob
import io
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from evopem.config.strict_yaml import MAX_DIGITS, read_value
from evopem.errors import InputError

_TEXT_COLUMNS = {
    "name",
    "file",
    "validation_file",
    "input_unit",
    "output_unit",
    "time_unit",
    "decimal_mark",
    "uneven_time",
}
_CHANNEL_COLUMNS = {"input", "output", "time"}
_SEPARATORS = ",;\t"
_INTEGER = re.compile(r"[+-]?[0-9]+")
_CHANNEL_NUMBER = re.compile(r"[0-9]+(\.0*)?")
_FLOAT = re.compile(
    r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?|[+-]?(inf|infinity)|nan", re.IGNORECASE
)
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(e[+-]?[0-9]+)?", re.IGNORECASE)
_BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}

T = TypeVar("T")
_PATHS = ("file", "validation_file")
Row = tuple[int, list[str]]
"""Number of the line where a row ends, and its fields."""


@dataclass(frozen=True)
class Table:
    """The data sets of a table."""

    entries: dict[str, Any]  # keys and values of each data set, by its name
    lines: dict[str, int]  # the line of each data set
    columns: tuple[str, ...]  # those that hold keys


def cell(line: int, column: str) -> str:
    """The place of a cell, for an error to name."""
    return f"line {line}, column {column}"


def read_table(path: str) -> Table:
    """Read a table of data sets; a dot in a column's name leads to a key below another one."""
    separator, (header_line, header), rows = _rows(path)
    columns = _columns(header, rows, path, header_line)
    comma_place = _decimal_comma(columns, rows, separator)
    entries: dict[str, Any] = {}
    lines: dict[str, int] = {}
    name_index = next(index for index, column in columns if column == "name")
    for line, row in rows:
        name = row[name_index].strip()
        if not name:
            raise InputError(path, "there is no name", "name the data set", cell(line, "name"))
        if name in entries:
            raise InputError(
                path,
                f"{name} stands here for the second time (first in line {lines[name]})",
                "give every data set a name of its own",
                cell(line, "name"),
            )
        lines[name] = line
        entries[name] = {}
        for index, column in columns:
            text = row[index].strip()
            if text and column != "name":
                value = _value(column, text, comma_place, path, cell(line, column))
                _put(entries[name], column.split("."), value)
    return Table(entries, lines, tuple(column for _, column in columns))


def _rows(path: str) -> tuple[str, Row, list[Row]]:
    """Read the separator, the header and the rows that are not empty."""
    text = _text(path)
    first_line = re.split(r"[\r\n]", text, maxsplit=1)[0]
    separator = max(_SEPARATORS, key=first_line.count)
    stated = re.match(r'"?sep=([,;\t])"?[ ,;\t]*(\r\n|\r|\n)', text, re.IGNORECASE)
    skipped = 0
    if stated:  # Excel's own statement of the separator
        separator, skipped = stated[1], 1
        text = text[stated.end() :]
    try:
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
        found = [(reader.line_num + skipped, row) for row in reader if any(map(str.strip, row))]
    except csv.Error as error:
        raise InputError(path, f"this is not a table ({error})", "save it as CSV") from None
    if len(found) < 2:
        raise InputError(path, "there are no data sets in it", "give a header and a row for each")
    header, rows = found[0], found[1:]
    width = len(header[1])
    for line, row in rows:
        if len(row) < width or any(map(str.strip, row[width:])):
            raise InputError(
                path,
                f"the row has {len(row)} fields and the header {width}",
                "give every row as many fields",
                f"line {line}",
            )
    return separator, header, rows


def check_locale(path: str, source: str, place: str = "") -> None:
    """Refuse a path that the locale cannot encode: Python would say that the file is missing."""
    try:
        os.fsencode(path)
    except UnicodeEncodeError:
        raise InputError(
            source,
            f"{path!r} cannot be a path in the locale of this process",
            "correct it, or set LC_ALL=C.UTF-8 and run again",
            place,
        ) from None


def _text(path: str) -> str:
    """Read the text of a table, in UTF-8 or in UTF-16 with a byte order mark."""
    check_locale(path, "datasets")
    try:
        content = Path(path).read_bytes() if not _is_special(path) else None
    except FileNotFoundError:
        raise InputError(
            path, "there is no such table", "correct the path after `datasets:`"
        ) from None
    except OSError as error:
        raise InputError(
            path, f"the table cannot be read ({error.strerror})", "check its path and permissions"
        ) from None
    except ValueError:
        raise InputError(
            repr(path[:100]),
            "this cannot be the path of a file",
            "correct the path after `datasets:`",
        ) from None
    if content is None:
        raise InputError(path, "is not a regular file", "give the path of a table")
    mark = next((mark for mark in _BYTE_ORDER_MARKS if content.startswith(mark)), b"")
    try:
        text = content[len(mark) :].decode(_BYTE_ORDER_MARKS.get(mark, "utf-8"))
    except UnicodeDecodeError as error:
        encoding = "UTF-16" if mark[:1] in b"\xfe\xff" and mark else "UTF-8"
        raise InputError(
            path, f"byte {error.start} is not {encoding}", "save the table as UTF-8"
        ) from None
    if "\0" in text:
        raise InputError(path, "there are null characters in it", "save the table as UTF-8")
    return text


def _is_special(path: str) -> bool:
    """Whether a path leads to a folder, a pipe or a device."""
    file = Path(path)
    return file.exists() and not file.is_file()


def _columns(header: list[str], rows: list[Row], path: str, line: int) -> list[tuple[int, str]]:
    """The columns that hold keys, with their positions."""
    names = [name.strip() for name in header]
    place = f"line {line}"
    columns = [(index, name) for index, name in enumerate(names) if name]
    for index in (index for index, name in enumerate(names) if not name):
        _check_unnamed(index, rows, path, place)
    twice = next((name for name, count in Counter(names).items() if name and count > 1), None)
    if twice is not None:
        raise InputError(path, f"two columns are called {twice!r}", "keep one", place)
    if "name" not in names:
        similar = next((name for name in names if name.lower() == "name"), None)
        hint = f" (did you mean {similar}?)" if similar else ""
        raise InputError(
            path, f"there is no column name{hint}", "add one: each row's folder", place
        )
    known = set(names)
    for _, name in columns:
        if "" in name.split("."):
            raise InputError(
                path, f"the column {name[:60]} has a dot too many", "write it as key.key", place
            )
        for above in _leading(name):
            if above in known:
                raise InputError(
                    path,
                    f"the columns {above} and {name} give the same key",
                    f"keep {above}.… or {above}",
                    place,
                )
    return columns


def _leading(name: str) -> Iterator[str]:
    """The keys above the one that a column's name leads to."""
    while "." in name:
        name = name.rpartition(".")[0]
        yield name


def _check_unnamed(index: int, rows: list[Row], path: str, place: str) -> None:
    """Accept a column without a name where it is empty or numbers the rows, from 0 or 1."""
    fields = [row[index].strip() for _, row in rows]
    for first in (0, 1):
        if fields == [str(number) for number in range(first, first + len(fields))]:
            return
    if any(fields):
        raise InputError(
            path, f"column {index + 1} has no name", "name it as a key, or delete it", place
        )


def _decimal_comma(columns: list[tuple[int, str]], rows: list[Row], separator: str) -> str:
    """The first cell with a decimal comma, where semicolons separate the columns; or no text."""
    if separator != ";":
        return ""
    for line, row in rows:
        for index, column in columns:
            if _is_number_column(column) and _DECIMAL_COMMA.fullmatch(row[index].strip()):
                return cell(line, column)
    return ""


def _is_number_column(column: str) -> bool:
    return column not in _TEXT_COLUMNS | _CHANNEL_COLUMNS


def _value(column: str, text: str, comma_place: str, path: str, place: str) -> Any:
    """Read a cell: a number, a list in brackets, or text."""
    if column in _TEXT_COLUMNS:
        return text
    if column in _CHANNEL_COLUMNS:
        # A single name may be in brackets, such as "[V]"; a list has several.
        if text.startswith("[") and text.endswith("]") and "," in text:
            return _list(text, path, place)
        return int(text.partition(".")[0]) if _is_channel_number(text) else text
    if text.startswith("["):
        return _list(text, path, place)
    if _INTEGER.fullmatch(text):
        if len(text) > MAX_DIGITS:
            raise InputError(path, f"the number has {len(text)} digits", "give fewer", place)
        return int(text)
    if comma_place and _DECIMAL_COMMA.fullmatch(text):
        return float(text.replace(",", "."))
    if not _FLOAT.fullmatch(text):
        return text
    if comma_place and "." in text:
        raise InputError(
            path,
            f"{text[:40]} has a point, and numbers have a decimal comma here ({comma_place})",
            "write all numbers with a decimal comma or all with a decimal point",
            place,
        )
    return float(text)


def _list(text: str, path: str, place: str) -> Any:
    try:
        return read_value(text, path, place)
    except InputError as error:
        shown = text if len(text) <= 60 else f"{text[:57]}..."
        raise InputError(
            path, f"{shown} is no list ({error.problem})", "write it as [6, 9]", place
        ) from None


def _is_channel_number(text: str) -> bool:
    return bool(_CHANNEL_NUMBER.fullmatch(text)) and len(text) <= MAX_DIGITS


def _put(entry: dict[str, Any], steps: list[str], value: Any) -> None:
    for step in steps[:-1]:
        entry = entry.setdefault(step, {})
    entry[steps[-1]] = value


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
