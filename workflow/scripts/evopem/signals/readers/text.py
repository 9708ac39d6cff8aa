"""Text tables: separated by commas, semicolons, tabs or blanks, with or without headings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers.channels import Channel, Contents, Reference, library
from evopem.signals.readers.text_dialect import (
    COMMENT_MARKS,
    Dialect,
    Lines,
    Row,
    choose_dialect,
    is_date,
    read_lines,
    refuse_ambiguous_thousands,
    refuse_split_decimals,
)
from evopem.signals.readers.text_heading import Heading, find_heading

SAMPLED_ROWS = 200
"""At most about this many rows decide on separator, decimal mark and number of columns."""

LONGEST_PREAMBLE = 50
"""Up to this line, what is no number may belong to a preamble that was taken for samples."""

_MISSING = ("", "nan", "+nan", "-nan")
"""What a field of a missing sample holds, in lower case."""


@contextmanager
def opened(
    path: Path,
    references: Sequence[Reference] = (),
    header_lines: int | None = None,
    decimal_mark: str | None = None,
) -> Iterator[Contents]:
    """The columns of a table; dates come as datetime64, missing numbers as NaN.

    The names that are asked for help to find the headings; a row above the numbers that may be a
    sample is refused unless ``header_lines`` counts it.
    """
    lines = read_lines(path)
    sample = _lower_half(lines.rows)
    dialect = choose_dialect(sample, lines.separator, decimal_mark)
    width = Counter(len(dialect.split(line)) for _, line in sample).most_common(1)[0][0]
    heading = find_heading(path, lines, sample, dialect, width, references, header_lines)
    data = lines.rows[heading.start :]
    _refuse_interruptions(path, lines, dialect, heading, width, header_lines)
    names, units = heading.names, heading.units
    if not names:
        above = lines.rows[heading.start - 1] if heading.start else None
        refuse_split_decimals(path, data[0], above, dialect, sample, width)
    closed = width > 1 and (not names or not names[-1]) and _ends_empty(sample, dialect, width)
    columns = width - closed
    names, units = ([*(each or [""] * width)][:columns] for each in (names, units))

    def load(places: Sequence[int]) -> list[Channel]:
        channels = []
        for place, fields in zip(
            places, _columns(path, data, dialect, columns, places), strict=True
        ):
            if decimal_mark is None:
                refuse_ambiguous_thousands(path, fields, dialect, place)
            values = _values(path, fields, dialect, data, place)
            _refuse_row_numbers(path, values, names, place)
            channels.append(Channel(names[place], values, units[place]))
        return channels

    yield Contents(path, "column", [(name,) for name in names], load)


def _lower_half(rows: Sequence[Row]) -> list[Row]:
    """At most about `SAMPLED_ROWS` rows, evenly out of the lower half of the file.

    Headings stand in the upper half; the last row may be cut short.
    """
    lower = rows[len(rows) // 2 : -1] or rows[-1:]
    step = max(1, len(lower) // SAMPLED_ROWS)
    return list(lower[::step])


def _ends_empty(sample: Sequence[Row], dialect: Dialect, width: int) -> bool:
    """Whether every row ends with a separator."""
    rows = [dialect.split(line) for _, line in sample]
    return not any(fields[-1].strip() for fields in rows if len(fields) == width)


def _refuse_interruptions(
    path: Path,
    lines: Lines,
    dialect: Dialect,
    heading: Heading,
    width: int,
    header_lines: int | None,
) -> None:
    """Refuse comments and blank lines in places where a sample may be missing."""
    first, last = lines.rows[heading.start][0], lines.rows[-1][0]
    named = bool(heading.names) and heading.start > 0
    headings = lines.rows[heading.start - 1][0] if named else first
    for number, line in lines.comments:
        bare = line.strip()
        problem = f'the line "{bare[:40]}"'
        stated = header_lines is not None and number <= header_lines
        if first < number < last:
            problem += " stands between rows of numbers, where it may be a damaged sample or begin"
            problem += " another table"
            remedy = "repair or remove that line"
        elif not stated and _may_be_sample(bare, dialect, width, below=number > headings):
            problem += " may be a comment or a damaged sample"
            remedy = "write a blank after the mark of a comment above the table, and remove the"
            remedy += " line below it"
        else:
            continue
        raise InputError(str(path), problem, remedy, f"line {number}")
    between = [number for number in lines.blanks if first < number < last]
    numbers = [number for number, _ in lines.rows[heading.start :]]
    # Double line ends leave a blank line after every row.
    if between and not all(below - above == 2 for above, below in pairwise(numbers)):
        problem = (
            "the line between rows of numbers is blank, so a sample may be missing or another"
            " table begin"
        )
        remedy = "remove that line or repair the recording"
        raise InputError(str(path), problem, remedy, f"line {between[0]}")


def _may_be_sample(line: str, dialect: Dialect, width: int, below: bool) -> bool:
    """Whether a line that begins like a comment may be a sample with a damaged first field.

    A comment has a blank after its mark; below the headings it holds no number in as many fields as
    a row has. Without the blank, it is no number and has not as many fields as a row.
    """
    rest = line.lstrip("".join(COMMENT_MARKS))
    fields, inner = dialect.split(line), dialect.split(rest.strip())
    if not rest or rest[0].isspace():
        rows = [row for row in (fields, inner) if len(row) == width]
        return below and any(dialect.is_value(text) for row in rows for text in row)
    if dialect.is_value(rest):
        return True
    return len(fields) == width and (below or any(map(dialect.is_value, fields[1:])))


def _columns(
    path: Path, rows: Sequence[Row], dialect: Dialect, width: int, columns: Sequence[int]
) -> list[list[str]]:
    """The fields of the columns asked for; every row must have the same number of fields.

    Table libraries are not used here, because they fill or drop short rows without a message.
    """
    taken: list[list[str]] = [[] for _ in columns]
    for number, line in rows:
        fields = dialect.split(line)
        if len(fields) == width + 1 and not fields[-1].strip():
            fields.pop()
        if len(fields) != width:
            problem = f"the row has {len(fields)} fields where the others have {width}"
            raise InputError(str(path), problem, "repair or remove that row", f"line {number}")
        for column, values in zip(columns, taken, strict=True):
            values.append(fields[column])
    return taken


def _values(
    path: Path, fields: list[str], dialect: Dialect, rows: Sequence[Row], column: int
) -> NDArray:
    """The fields of one column as numbers, or as dates when the first one is a date."""
    if is_date(fields[0]) and not dialect.is_number(fields[0]):
        return _dates(path, fields, rows, column)
    comma = dialect.decimal_mark == ","
    plain = [dialect.number(text) for text in fields] if comma else fields
    # Python takes an underscore between digits for part of a number.
    doubtful = any("_" in text or (comma and "." in text) for text in fields)
    with suppress(ValueError):
        if not doubtful:
            values = np.array([float(text) for text in plain])
            if np.isfinite(values).all():
                return values
    values = np.full(len(fields), np.nan)
    for index, ((line, _), text) in enumerate(zip(rows, fields, strict=True)):
        if text.strip().lower() in _MISSING:
            continue
        if dialect.is_number(text):
            values[index] = float(dialect.number(text))
        # Infinity may be what an instrument wrote; that of digits is damage.
        if np.isnan(values[index]) or (np.isinf(values[index]) and any(map(str.isdigit, text))):
            _refuse_field(path, text, dialect, line, column)
    return values


def _refuse_field(path: Path, text: str, dialect: Dialect, line: int, column: int) -> NoReturn:
    shown = text.strip()
    other = "." if dialect.decimal_mark == "," else ","
    problem = f'"{shown[:40]}" is not a finite number'
    if other in shown and dialect.is_number(shown.replace(other, "")):
        problem += f' with a decimal "{dialect.decimal_mark}"'
    remedy = "repair or remove that sample"
    if line <= LONGEST_PREAMBLE:
        remedy += ", or set header_lines if the first sample stands below it"
    raise InputError(str(path), problem, remedy, f"line {line}, column {column + 1}")


def _dates(path: Path, fields: list[str], rows: Sequence[Row], column: int) -> NDArray:
    pandas = library("pandas", path)

    for index, text in enumerate(fields):
        if not is_date(text):
            shown = text.strip()[:40]
            problem = f'"{shown}" is not a date like those above' if shown else "the field is empty"
            remedy = "repair or remove that sample"
            raise InputError(
                str(path), problem, remedy, f"line {rows[index][0]}, column {column + 1}"
            )
    try:
        stamps = pandas.to_datetime(
            [text.strip().replace(",", ".") for text in fields], format="ISO8601", utc=True
        )
    except ValueError as error:
        problem = f"the dates cannot be read ({error})"
        remedy = "write them as 2024-05-31T12:00:00.000"
        raise InputError(str(path), problem, remedy, f"column {column + 1}") from None
    return stamps.tz_localize(None).to_numpy().astype("datetime64[ns]")


def _refuse_row_numbers(path: Path, values: NDArray, names: Sequence[str], column: int) -> None:
    """Refuse the column without a heading that R and pandas write in front of the others."""
    nameless = any(names) and not names[column]
    if nameless and values.dtype.kind == "f" and values.size > 1 and (np.diff(values) == 1).all():
        problem = (
            f"the column has no heading and holds the row numbers {values[0]:g} to {values[-1]:g}"
        )
        raise InputError(str(path), problem, "choose another column", f"column {column + 1}")
