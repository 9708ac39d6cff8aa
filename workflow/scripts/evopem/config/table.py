"""The data sets of a configuration: written one by one, by a name with a `*`, or in a table.

A table has a row for each recording and a column for each key, as spreadsheets, pandas and MATLAB
write them: in UTF-8 or UTF-16, with row numbers, empty rows and columns, or decimal commas.
"""

import codecs
import csv
import glob
import io
import os
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from evopem.config.strict_yaml import Keys, read_value
from evopem.errors import InputError

_PATHS = ("file", "validation_file")
_UNIT_COLUMNS = ("input_unit", "output_unit", "time_unit")
_TEXT_COLUMNS = ("name", *_PATHS, *_UNIT_COLUMNS, "decimal_mark", "uneven_time")
_CHANNEL_COLUMNS = ("input", "output", "time")
_SEPARATORS = ",;\t"
_INTEGER = re.compile(r"[+-]?[0-9]{1,30}")
_CHANNEL_NUMBER = re.compile(r"[0-9]{1,30}(\.0*)?")
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
Row = tuple[int, list[str]]  # number of the line where a row ends, and its fields


@dataclass(frozen=True)
class Origin:
    """Where the user wrote the data sets, for an error to name."""

    source: str  # the configuration, or the table
    templates: Mapping[str, str] = field(default_factory=dict)  # a data set's name with a *
    lines: Mapping[str, int] = field(default_factory=dict)  # of a table
    columns: tuple[str, ...] = ()  # of a table

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


def _cell(line: int, column: str) -> str:
    return f"line {line}, column {column}"


def expand(written: Any, source: str) -> tuple[Any, Origin]:
    """Write out every data set of a configuration's ``datasets:``."""
    if isinstance(written, str):
        return _read_table(written)
    if not isinstance(written, Mapping):
        return written, Origin(source)
    datasets: Keys = {}
    templates: dict[str, str] = {}
    for name, entry in written.items():
        files = {name: entry}
        if "*" in str(name):
            files = _matching(name, entry, source)
            templates |= dict.fromkeys(files, str(name))
        for twin in datasets.keys() & files.keys():
            problem = f"{twin} is also the name of another data set"
            remedy = "put a letter or digit before or after the *"
            raise InputError(source, problem, remedy, f"datasets.{name}")
        datasets |= files
    return datasets, Origin(source, templates)


def _matching(name: str, entry: Any, source: str) -> Keys:
    """Write out one entry for every file that its pattern matches, by what its `*` stands for."""
    pattern = entry.get("file") if isinstance(entry, Mapping) else None
    if not isinstance(pattern, str) or pattern.count("*") != 1 or name.count("*") != 1:
        problem = "a name with a * stands for all files of a pattern"
        remedy = f"write one * in the name and one in `file`, as in `{name}: {{file: data/*.csv}}`"
        raise InputError(source, problem, remedy, f"datasets.{name}")
    before, after = pattern.split("*")
    entries = {}
    for file in _files(pattern, source, f"datasets.{name}.file"):
        middle = file[len(before) : len(file) - len(after)]
        entries[name.replace("*", middle)] = {
            key: value.replace("*", middle) if key in _PATHS and isinstance(value, str) else value
            for key, value in entry.items()
        }
    return entries


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
    matching = sorted(glob.glob("*".join(map(glob.escape, written.split("*")))))  # noqa: PTH207
    if not matching:
        raise InputError(source, f"no file matches {written}", "correct the pattern", place)
    return matching


def shard_of(datasets: Mapping[str, T], shard: str, source: str) -> dict[str, T]:
    """Take every n-th data set: ``3/40`` is the third and every fortieth after it."""
    number, count = map(int, shard.split("/"))
    if number > count:
        remedy = f"give a number from 1 to {count}"
        raise InputError(source, f"there is no shard {shard}", remedy, "shard")
    return dict(list(datasets.items())[number - 1 :: count])


def _read_table(path: str) -> tuple[Keys, Origin]:
    """Read a table of data sets; a dot in a column's name leads to a key below another one."""
    separator, (header_line, header), rows = _rows(path)
    columns = _columns(header, rows, path, f"line {header_line}")
    comma_place = _decimal_comma(columns, rows) if separator == ";" else ""
    entries: Keys = {}
    lines: dict[str, int] = {}
    for line, row in rows:
        cells = {column: row[index].strip() for index, column in columns}
        name, at_name = cells.pop("name"), _cell(line, "name")
        if not name:
            raise InputError(path, "there is no name", "name the data set", at_name)
        if name in entries:
            problem = f"{name} stands here for the second time (first in line {lines[name]})"
            raise InputError(path, problem, "give every data set a name of its own", at_name)
        lines[name], entries[name] = line, {}
        for column, text in cells.items():
            if text:
                *groups, key = column.split(".")
                entry = entries[name]
                for group in groups:
                    entry = entry.setdefault(group, {})
                entry[key] = _value(column, text, comma_place, path, _cell(line, column))
    return entries, Origin(path, lines=lines, columns=tuple(column for _, column in columns))


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
        numbered = [(reader.line_num + skipped, row) for row in reader if any(map(str.strip, row))]
    except csv.Error as error:
        raise InputError(path, f"this is not a table ({error})", "save it as CSV") from None
    if len(numbered) < 2:
        raise InputError(path, "there are no data sets in it", "give a header and a row for each")
    header, *rows = numbered
    width = len(header[1])
    for line, row in rows:
        if len(row) < width or any(map(str.strip, row[width:])):
            problem = f"the row has {len(row)} fields and the header {width}"
            raise InputError(path, problem, "give every row as many fields", f"line {line}")
    return separator, header, rows


def check_locale(path: str, source: str, place: str = "") -> None:
    """Refuse a path that the locale cannot encode: Python would say that the file is missing."""
    try:
        os.fsencode(path)
    except UnicodeEncodeError:
        problem = f"{path!r} cannot be a path in the locale of this process"
        remedy = "correct it, or set LC_ALL=C.UTF-8 and run again"
        raise InputError(source, problem, remedy, place) from None


def _text(path: str) -> str:
    """Read the text of a table, in UTF-8 or in UTF-16 with a byte order mark."""
    check_locale(path, "datasets")
    is_plain = path.strip() and path.isprintable() and len(path) < 100
    shown = path if is_plain else f"config.yaml, datasets: {path[:100]!r}"
    try:
        is_other = Path(path).exists() and not Path(path).is_file()
        content = b"" if is_other else Path(path).read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it cannot be the path of a file"
        problem = f"the table cannot be read ({reason})"
        raise InputError(shown, problem, "correct the path after `datasets:`") from None
    if is_other:
        raise InputError(shown, "is not a regular file", "give the path of a table")
    mark = next((mark for mark in _BYTE_ORDER_MARKS if content.startswith(mark)), b"")
    try:
        text = content[len(mark) :].decode(_BYTE_ORDER_MARKS.get(mark, "utf-8"))
    except UnicodeDecodeError as error:
        encoding = "UTF-16" if mark[:1] in b"\xfe\xff" and mark else "UTF-8"
        problem = f"byte {error.start} is not {encoding}"
        raise InputError(path, problem, "save the table as UTF-8") from None
    if "\0" in text:
        raise InputError(path, "there are null characters in it", "save the table as UTF-8")
    return text


def _columns(header: list[str], rows: list[Row], path: str, place: str) -> list[tuple[int, str]]:
    """The columns that hold keys, with their positions."""

    def refuse(problem: str, remedy: str) -> NoReturn:
        raise InputError(path, problem, remedy, place)

    names = [name.strip() for name in header]
    columns = [(index, name) for index, name in enumerate(names) if name]
    for index in (index for index, name in enumerate(names) if not name):
        # Without a name it is empty or numbers the rows, from 0 or 1.
        fields = [row[index].strip() for _, row in rows]
        counted = ([str(number + first) for number in range(len(fields))] for first in (0, 1))
        if any(fields) and fields not in counted:
            refuse(f"column {index + 1} has no name", "name it as a key, or delete it")
    for name, count in Counter(name for _, name in columns).items():
        if count > 1:
            refuse(f"two columns are called {name!r}", "keep one")
    if "name" not in names:
        similar = [f" (did you mean {name}?)" for name in names if name.lower() == "name"]
        refuse(f"there is no column name{''.join(similar[:1])}", "add one: each row's folder")
    known = set(names)
    for _, name in columns:
        above = list(accumulate(name.split("."), "{}.{}".format))[:-1]
        if "" in name.split("."):
            refuse(f"the column {name[:60]} has a dot too many", "write it as key.key")
        for twin in known.intersection(above):
            problem = f"the columns {twin} and {name} give the same key"
            refuse(problem, f"keep {twin}.… or {twin}")
    return columns


def _decimal_comma(columns: list[tuple[int, str]], rows: list[Row]) -> str:
    """The first cell with a decimal comma; or no text."""
    numbers = [column for column in columns if column[1] not in (*_TEXT_COLUMNS, *_CHANNEL_COLUMNS)]
    for line, row in rows:
        for index, column in numbers:
            if _DECIMAL_COMMA.fullmatch(row[index].strip()):
                return _cell(line, column)
    return ""


def _value(column: str, text: str, comma_place: str, path: str, place: str) -> Any:
    """Read a cell: a number, a list in brackets, or text."""
    if column in _TEXT_COLUMNS:
        return text
    is_channel = column in _CHANNEL_COLUMNS
    # A single channel may be in brackets, such as "[V]"; a list has several.
    if text.startswith("[") and (not is_channel or (text.endswith("]") and "," in text)):
        try:
            return read_value(text, path, place)
        except InputError as error:
            shown = text if len(text) <= 60 else f"{text[:57]}..."
            problem = f"{shown} is no list ({error.problem})"
            raise InputError(path, problem, "write it as [6, 9]", place) from None
    if is_channel:
        return int(text.partition(".")[0]) if _CHANNEL_NUMBER.fullmatch(text) else text
    if _INTEGER.fullmatch(text):
        return int(text)
    if comma_place and _DECIMAL_COMMA.fullmatch(text):
        return float(text.replace(",", "."))
    if not _FLOAT.fullmatch(text):
        return text
    if comma_place and "." in text:
        problem = f"{text[:40]} has a point, and numbers have a decimal comma here ({comma_place})"
        remedy = "write all numbers with a decimal comma or all with a decimal point"
        raise InputError(path, problem, remedy, place)
    return float(text)
