"""Text tables: separated by commas, semicolons, tabs or blanks, with or without headings."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers import text_dialect
from evopem.signals.readers.open_file import Channel, Contents, Reference, library
from evopem.signals.readers.text_heading import Heading, find_heading

LONGEST_PREAMBLE = 50
"""Up to this line, what is no number may belong to a preamble that was taken for samples."""

_CLOCK = re.compile(r"\d:\d\d")
_MISSING = ("", "nan", "+nan", "-nan")  # what a field of a missing sample holds, in lower case


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
    table = text_dialect.read_table(path, decimal_mark)
    heading = find_heading(table, references, header_lines)
    _refuse_interruptions(table, heading, header_lines or 0)
    if not heading.names:
        text_dialect.refuse_split_decimals(table, heading.start)
    blank = [""] * table.width
    names, units = [*(heading.names or blank)], [*(heading.units or blank)]
    # Every row may end with a separator.
    ends_empty = table.width > 1 and not any(fields[-1].strip() for fields in table.sample)
    columns = table.width - (ends_empty and not names[-1])

    def load(column: int) -> Channel:
        fields = _column(table, heading.start, columns, column)
        if decimal_mark is None:
            text_dialect.refuse_ambiguous_thousands(table, fields, column)
        numbers = [number for number, _ in table.rows[heading.start :]]
        values = _values(table, fields, numbers, column)
        # R and pandas write the row numbers in front, without a heading.
        nameless = bool(heading.names) and not names[column] and values.dtype.kind == "f"
        if nameless and values.size > 1 and np.all(np.diff(values) == 1):
            held = f"the row numbers {values[0]:g} to {values[-1]:g}"
            problem = f"the column has no heading and holds {held}"
            raise InputError(str(path), problem, "choose another column", f"column {column + 1}")
        return Channel(names[column], values, units[column])

    yield Contents(path, "column", [(name,) for name in names[:columns]], load)


def _refuse_interruptions(table: text_dialect.Table, heading: Heading, header_lines: int) -> None:
    """Refuse comments and blank lines in places where a sample may be missing."""
    rows = table.rows[heading.start :]
    first, last = rows[0][0], rows[-1][0]
    named = bool(heading.names) and heading.start > 0
    headings = table.rows[heading.start - 1][0] if named else first
    source = str(table.path)
    for number, line in table.comments:
        bare = line.strip()
        problem = f'the line "{bare[:40]}"'
        if first < number < last:
            problem += " stands between rows of numbers, where it may be a damaged sample or begin"
            problem += " another table"
            raise InputError(source, problem, "repair or remove that line", f"line {number}")
        if number > header_lines and _may_be_sample(table, bare, below=number > headings):
            problem += " may be a comment or a damaged sample"
            remedy = "write a blank after the mark of a comment above the table, and remove the"
            remedy += " line below it"
            raise InputError(source, problem, remedy, f"line {number}")
    between = [number for number in table.blanks if first < number < last]
    # Double line ends leave a blank line after every row.
    if between and not all(below[0] - above[0] == 2 for above, below in pairwise(rows)):
        problem = (
            "the line between rows of numbers is blank, so a sample may be missing or another"
            " table begin"
        )
        remedy = "remove that line or repair the recording"
        raise InputError(source, problem, remedy, f"line {between[0]}")


def _may_be_sample(table: text_dialect.Table, line: str, below: bool) -> bool:
    """Whether a line that begins like a comment may be a sample with a damaged first field. A
    comment has a blank after its mark; below the headings it holds no number in as many fields as a
    row has. Without the blank, it is no number and has not as many fields as a row."""
    is_value = table.dialect.is_value
    rest = line.lstrip("".join(text_dialect.COMMENT_MARKS))
    fields, inner = table.dialect.split(line), table.dialect.split(rest.strip())
    if not rest or rest[0].isspace():
        rows = [row for row in (fields, inner) if len(row) == table.width]
        return below and any(is_value(text) for row in rows for text in row)
    if is_value(rest):
        return True
    return len(fields) == table.width and (below or any(map(is_value, fields[1:])))


def _column(table: text_dialect.Table, start: int, width: int, column: int) -> list[str]:
    """The fields of one column; every row must have the same number of fields. Table libraries are
    not used here, because they fill or drop short rows without a message."""
    taken = []
    for number, line in table.rows[start:]:
        fields = table.dialect.split(line)
        if len(fields) == width + 1 and not fields[-1].strip():
            fields.pop()
        if len(fields) != width:
            problem = f"the row has {len(fields)} fields where the others have {width}"
            remedy = "repair or remove that row"
            raise InputError(str(table.path), problem, remedy, f"line {number}")
        taken.append(fields[column])
    return taken


def _values(table: text_dialect.Table, fields: list[str], lines: list[int], column: int) -> NDArray:
    """The fields of one column as numbers, or as dates when the first one is a date."""
    dialect = table.dialect
    dated = text_dialect.is_date(fields[0]) and not dialect.is_number(fields[0])
    comma = dialect.decimal_mark == ","
    # Python takes an underscore between digits for part of a number.
    if not dated and not any("_" in text or (comma and "." in text) for text in fields):
        with suppress(ValueError):
            plain = map(dialect.number, fields) if comma else fields
            values = np.array([float(text) for text in plain])
            if np.isfinite(values).all():
                return values
    values = np.full(len(fields), np.nan)
    for index, (line, text) in enumerate(zip(lines, fields, strict=True)):
        shown = text.strip()
        problem, remedy = "", "repair or remove that sample"
        if dated:
            if not text_dialect.is_date(text):
                problem = f'"{shown[:40]}" is no date like those above' if shown else "it is empty"
        elif shown.lower() not in _MISSING:
            if dialect.is_number(text):
                values[index] = float(dialect.number(text))
            # Infinity may be what an instrument wrote; that of digits is damage.
            if np.isnan(values[index]) or (np.isinf(values[index]) and any(map(str.isdigit, text))):
                problem = f'"{shown[:40]}" is not a finite number'
                swapped = "." if comma else ","
                if swapped in shown and dialect.is_number(shown.replace(swapped, "")):
                    problem += f' with a decimal "{dialect.decimal_mark}"'
                elif _CLOCK.search(shown):
                    problem = f'"{shown[:40]}" is no date of a known form'
                    remedy = "write dates as 2024-05-31T12:00:00.000, or leave time out and state"
                    remedy += " sampling_rate"
        if problem:
            if line <= LONGEST_PREAMBLE:
                remedy += ", or set header_lines if the first sample stands below it"
            place = f"line {line}, column {column + 1}"
            raise InputError(str(table.path), problem, remedy, place)
    return _dates(table.path, fields, column) if dated else values


def _dates(path: Path, fields: list[str], column: int) -> NDArray:
    pandas = library("pandas", path)
    texts = list(map(text_dialect.iso_date, fields))
    try:
        stamps = pandas.to_datetime(texts, format="ISO8601", utc=True)
    except ValueError as error:
        problem = f"the dates cannot be read ({error})"
        remedy = "write them as 2024-05-31T12:00:00.000"
        raise InputError(str(path), problem, remedy, f"column {column + 1}") from None
    return stamps.tz_localize(None).to_numpy().astype("datetime64[ns]")
