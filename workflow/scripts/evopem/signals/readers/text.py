"""Text tables: separated by commas, semicolons, tabs or blanks, with or without a header."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers.channels import Channel, Reference, find_channel

COMMENT_MARKS = ("#", "%", "//", "!")
SAMPLED_ROWS = 200
"""So many rows, spread evenly over the file, decide on separator and decimal mark."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.I)
_DATE = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d([.,]\d+)?)?)?(Z|[+-]\d\d:?\d\d)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")

Row = tuple[int, str]  # line number from 1, and the line


@dataclass(frozen=True)
class _Dialect:
    separator: str | None  # None: any run of blanks
    decimal: str
    quoted: bool = False
    closed: bool = False  # every row ends with a separator

    def split(self, line: str) -> list[str]:
        if self.separator is None:
            return line.split()
        if self.quoted:
            fields = next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))
        else:
            fields = line.split(self.separator)
        if self.closed and not fields[-1].strip():
            fields.pop()
        return fields

    def number(self, field: str) -> str:
        """The field as Python spells a number, were it one."""
        spelled = field.strip().replace("D", "E").replace("d", "e")
        return spelled.replace(",", ".") if self.decimal == "," else spelled

    def is_number(self, field: str) -> bool:
        field = field.strip()
        if self.decimal == ",":
            if "." in field:
                return False
            field = field.replace(",", ".")
        return _NUMBER.fullmatch(field) is not None

    def is_value(self, field: str) -> bool:
        return self.is_number(field) or _DATE.fullmatch(field.strip()) is not None


def read(path: Path, references: Sequence[Reference]) -> list[Channel]:
    """Read columns of a text table by their number or their name in the header.

    Parameters
    ----------
    path : Path
    references : sequence of int or str

    Returns
    -------
    list of Channel
        In the order of the references; dates come as datetime64.

    Raises
    ------
    InputError
        When the file is not text, holds no table, a row has another number of fields, a
        field that is needed is not a finite number, the decimal mark cannot be told, or
        there is no such column.
    """
    rows, comments = _rows(path)
    sample = _spread(rows)
    dialect = _dialect(sample)
    split = [dialect.split(line) for _, line in sample]
    if dialect.separator and len(split[0]) > 1 and not any(fields[-1].strip() for fields in split):
        dialect = replace(dialect, closed=True)
        split = [fields[:-1] for fields in split]
    width = Counter(len(fields) for fields in split).most_common(1)[0][0]
    start = _first_data_row(path, rows, dialect)
    names, units = _header(rows[:start], comments, rows[start][0], dialect, width)
    _refuse_split_decimals(path, rows, start, split, dialect, names)
    if not names:
        names, units = [""] * width, [""] * width
    columns = [_find_column(path, reference, names) for reference in references]
    data = rows[start:]
    return [
        Channel(names[column], _values(path, fields, dialect, data, column), units[column])
        for column, fields in zip(
            columns, _columns(path, data, dialect, width, columns), strict=True
        )
    ]


def _rows(path: Path) -> tuple[list[Row], list[Row]]:
    """The lines that hold something: those of the table, and the comments."""
    lines = _decode(path).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    rows: list[Row] = []
    comments: list[Row] = []
    for number, line in enumerate(lines, start=1):
        bare = line.strip()
        if bare:
            (comments if bare.startswith(COMMENT_MARKS) else rows).append((number, line))
    if not rows:
        raise InputError(str(path), "holds no rows of numbers", "export the recording again")
    return rows, comments


def _decode(path: Path) -> str:
    data = path.read_bytes()
    wide = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        # Instruments write units such as m/s² in an 8-bit code; the numbers are the same in all.
        text = data.decode("latin-1")
    found = _CONTROL.search(text)
    if found:
        raise InputError(
            str(path),
            "is not a text file",
            "give it the extension of its real format or export it as text",
            f"line {text.count(chr(10), 0, found.start()) + 1}",
        )
    return text


def _spread(rows: Sequence[Row]) -> list[Row]:
    """At most about `SAMPLED_ROWS` rows, evenly out of the whole file.

    Counted back from the last but one: the last may be cut short, the first be a header.
    """
    step = max(1, len(rows) // SAMPLED_ROWS)
    return list(rows[-2::-step][::-1]) if len(rows) > 1 else list(rows)


def _dialect(sample: Sequence[Row]) -> _Dialect:
    """The separator and decimal mark under which most fields are numbers.

    On a tie the earlier one wins: a point before a comma as the decimal mark.
    """
    quoted = any('"' in line for _, line in sample)
    choices = [
        _Dialect(separator, decimal, quoted and separator is not None)
        for decimal in (".", ",")
        for separator in ("\t", ";", ",", None)
        # Comma both as separator and decimal mark works only where quotes hold numbers together.
        if not (separator == "," and decimal == "," and not quoted)
    ]

    def share_of_values(dialect: _Dialect) -> float:
        fields = [field for _, line in sample for field in dialect.split(line) if field.strip()]
        return sum(map(dialect.is_value, fields)) / max(1, len(fields))

    return max(choices, key=share_of_values)


def _first_data_row(path: Path, rows: Sequence[Row], dialect: _Dialect) -> int:
    """Index of the first row of which at least half the fields are numbers or dates."""
    for index, (_, line) in enumerate(rows):
        fields = [field for field in dialect.split(line) if field.strip()]
        if 2 * sum(map(dialect.is_value, fields)) >= len(fields) > 0:
            return index
    raise InputError(
        str(path),
        "holds no row of numbers",
        "write one row a sample, separated by commas, semicolons, tabs or blanks",
        f"line {rows[0][0]}",
    )


def _header(
    before: Sequence[Row],
    comments: Sequence[Row],
    first_data_line: int,
    dialect: _Dialect,
    width: int,
) -> tuple[list[str], list[str]]:
    """Names and units of the columns; both empty when nothing above the data fits.

    A header is the row right above the data with a name for every column, or the last
    comment line above the data when it has as many. A row of units may stand between.
    """
    fitting = [fields for _, line in before if len(fields := dialect.split(line)) == width]
    above = [fields for fields in fitting[-2:] if any(field.strip() for field in fields)]
    if not above:
        for number, line in reversed(comments):
            if number < first_data_line:
                above = [dialect.split(line.strip().lstrip("".join(COMMENT_MARKS)).strip())]
                break
    if not above or len(above[0]) != width:
        return [], []
    names = [field.strip() for field in above[0]]
    units = [field.strip().strip("[]()") for field in above[1]] if len(above) > 1 else []
    return names, units or [""] * width


def _find_column(path: Path, reference: Reference, names: Sequence[str]) -> int:
    if isinstance(reference, str) and not any(names):
        raise InputError(
            str(path),
            f'there is no column "{reference}", because the table has no header with a name for'
            f" each of its {len(names)} columns",
            f"give the number of the column, 1 to {len(names)}",
        )
    return find_channel(path, reference, names, "column")


def _columns(
    path: Path,
    rows: Sequence[Row],
    dialect: _Dialect,
    width: int,
    columns: Sequence[int],
) -> list[list[str]]:
    """The fields of the columns asked for; every row must have the same number of fields.

    Read here and not by a table library, because those fill or drop short rows in silence.
    """
    taken: list[list[str]] = [[] for _ in columns]
    for number, line in rows:
        fields = dialect.split(line)
        if len(fields) != width:
            raise InputError(
                str(path),
                f"the row has {len(fields)} fields where the others have {width}",
                "repair or remove that row",
                f"line {number}",
            )
        for column, values in zip(columns, taken, strict=True):
            values.append(fields[column])
    return taken


def _values(
    path: Path, fields: list[str], dialect: _Dialect, rows: Sequence[Row], column: int
) -> NDArray:
    """The fields of one column as finite numbers, or as dates when the first one is a date."""
    if dialect.decimal == ",":
        _refuse_thousands(path, fields, column)
    if _DATE.fullmatch(fields[0].strip()) and not dialect.is_number(fields[0]):
        return _dates(path, fields, rows, column)
    try:
        # An underscore between digits is a number to Python and to nobody else.
        if any("_" in field for field in fields):
            raise ValueError
        plain = fields if dialect.decimal == "." else [dialect.number(field) for field in fields]
        values = np.array([float(field) for field in plain])
    except ValueError:
        for index, field in enumerate(fields):
            if not dialect.is_number(field):
                _refuse_field(path, field, rows[index][0], column)
        values = np.array([float(dialect.number(field)) for field in fields])
    finite = np.isfinite(values)
    if not finite.all():
        first = int(np.argmin(finite))
        _refuse_field(path, fields[first], rows[first][0], column)
    return values


def _refuse_field(path: Path, field: str, line: int, column: int) -> NoReturn:
    shown = field.strip()
    raise InputError(
        str(path),
        f'"{shown[:40]}" is not a finite number' if shown else "the field is empty",
        "repair or remove that sample",
        f"line {line}, column {column + 1}",
    )


def _dates(path: Path, fields: list[str], rows: Sequence[Row], column: int) -> NDArray:
    import pandas as pd

    bad = [index for index, field in enumerate(fields) if not _DATE.fullmatch(field.strip())]
    if bad:
        _refuse_field(path, fields[bad[0]], rows[bad[0]][0], column)
    try:
        stamps = pd.to_datetime(
            [field.strip().replace(",", ".") for field in fields], format="ISO8601", utc=True
        )
    except ValueError as error:
        raise InputError(
            str(path),
            f"the dates cannot be read ({error})",
            "write them as 2024-05-31T12:00:00.000",
            f"column {column + 1}",
        ) from None
    return stamps.tz_localize(None).to_numpy().astype("datetime64[ns]")


def _refuse_thousands(path: Path, fields: Sequence[str], column: int) -> None:
    """Refuse a column whose commas may as well part thousands as mark decimals."""
    with_comma = [field.strip() for field in fields if "," in field]
    if with_comma and all(_THOUSANDS.fullmatch(field) for field in with_comma):
        raise InputError(
            str(path),
            f'"{with_comma[0]}" may mean a decimal comma or a thousands separator',
            "export the numbers with a decimal point",
            f"column {column + 1}",
        )


def _refuse_split_decimals(
    path: Path,
    rows: Sequence[Row],
    start: int,
    sample: Sequence[Sequence[str]],
    dialect: _Dialect,
    names: Sequence[str],
) -> None:
    """Refuse a comma-separated table whose commas seem to be decimal marks as well.

    The signs: whole numbers only, in an even number of columns, and either the header has
    half as many names, or (without a header) fields such as "-0" before and "05" after the
    comma, which no one writes in a table of whole numbers.
    """
    width = len(sample[-1])
    if dialect.separator != "," or dialect.decimal != "." or names or width % 2:
        return
    fields = [[field.strip() for field in row] for row in sample if len(row) == width]
    if any("." in field for row in fields for field in row):
        return
    halved = start > 0 and len(rows[start - 1][1].split(",")) * 2 == width
    odd = any(
        row[place] in {"-0", "+0"} or re.fullmatch(r"0\d+", row[place + 1])
        for row in fields
        for place in range(0, width, 2)
    )
    if halved or odd:
        raise InputError(
            str(path),
            "the comma seems to be both the separator and the decimal mark",
            "export the table with semicolons or with decimal points",
            f"line {rows[start][0]}",
        )
