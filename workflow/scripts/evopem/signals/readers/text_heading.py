"""Where the numbers of a text table begin, and the headings and units above them."""

import re
from collections.abc import Sequence
from typing import NamedTuple, NoReturn

from evopem.errors import InputError
from evopem.signals.readers.open_file import UNIT, Reference
from evopem.signals.readers.text_dialect import COMMENT_MARKS, Table

_NO_VALUE = {
    "-", "--", "---", "?", "*", "n/a", "na", "nan", "nil", "none", "null", "missing", "invalid",
    "bad", "err", "error", "ol", "ovld", "over", "overflow", "overload", "overrange", "ovrng",
    "saturated", "underflow", "underrange",
}  # fmt: skip
"""What instruments write in place of a number, in lower case."""

_NEARLY_NUMBER = re.compile(r"(?=.*\d)[+-]?[\d.,][\d.,:;/_ '’%exEX+-]*")
"""A number that is spoilt, or a time of day."""

_BRACKETED = re.compile(r"\[[^\[\]]*\]|\([^()]*\)")


class Heading(NamedTuple):
    """What stands above the numbers of a table."""

    start: int  # index of the first row of numbers among the rows
    names: Sequence[str] = ()  # one text a column, or none
    units: Sequence[str] = ()


def find_heading(
    table: Table, references: Sequence[Reference], header_lines: int | None = None
) -> Heading:
    """Find the first row of numbers, the names of the columns and their units.

    Headings are the row of texts directly above, or above a row of units, else the last comment
    with a text for each column. Every other row between might be a sample and is refused, unless
    `header_lines` counts it.
    """
    wanted = {reference for reference in references if isinstance(reference, str)}
    if header_lines is not None:
        return _stated(table, wanted, header_lines)
    start = next((i for i in range(len(table.rows)) if table.kind(i) == "numbers"), None)
    if start is None:
        remedy = "write one row a sample, separated by commas, semicolons, tabs or blanks"
        place = f"line {table.rows[0][0]}"
        raise InputError(str(table.path), "holds no row of numbers", remedy, place)
    if _counts_columns(table, start):
        return _numbered_columns(table, start)
    if start == 0:
        return Heading(start, *_in_comments(table, start))
    above, kind = table.fields(start - 1), table.kind(start - 1)
    names = _other_width(table, start) if kind == "other" else []
    if names:
        return Heading(start, names)
    has_units = kind == "text" and start > 1 and is_unit_row(above)
    if has_units and table.kind(start - 2) in ("text", "mixed"):
        return Heading(start, table.fields(start - 2), _bare_units(above))
    if _may_be_sample(table, start, wanted):
        _refuse(table, start - 1, start)
    return Heading(start, above if kind == "text" else ())


def _may_be_sample(table: Table, start: int, wanted: set[str]) -> bool:
    """Whether the row above the numbers may be a damaged sample, or is no heading for certain."""
    above, kind = table.fields(start - 1), table.kind(start - 1)

    def is_full(index: int) -> bool:
        return table.kind(index) == "text" and all(table.wanted(table.fields(index)))

    def may_replace_number(text: str) -> bool:
        spoilt = _NEARLY_NUMBER.fullmatch(text) is not None
        return spoilt or text.lower() in _NO_VALUE or table.dialect.is_number(text)

    if kind == "other":
        filled = [text for text in above if text]
        return any(map(is_full, range(start))) or all(map(may_replace_number, filled))
    if kind != "text":
        return True
    if wanted.isdisjoint(above):
        filled = [text for text in above if text]
        if len(filled) > 1 and len(set(filled)) == 1:
            return True
        if any(map(may_replace_number, table.wanted(above))):
            return True
    # Two full rows of texts, of which the second holds no units.
    follows = start > 1 and table.rows[start - 2][0] + 1 == table.rows[start - 1][0]
    return follows and is_full(start - 2)


def _counts_columns(table: Table, start: int) -> bool:
    """Whether the first row numbers the columns: 0, 1, … or 1, 2, …, maybe after a blank."""
    if table.width < 2 or len(table.rows) < start + 2:
        return False
    fields = table.fields(start)
    counted = fields if fields[0] else fields[1:]
    counts = any(counted == [str(base + i) for i in range(len(counted))] for base in (0, 1))
    return counts and not any(table.kind(i) == "text" for i in range(start))


def _numbered_columns(table: Table, start: int) -> Heading:
    """Headings 0, 1, …, where the numbers below are certainly written in another way."""
    first = table.fields(start)
    below = [[text.strip() for text in fields] for fields in table.sample]
    below = [fields for fields in below if fields != first]
    in_front = bool(below) and not first[0] and all(fields[0] for fields in below)
    mark = table.dialect.decimal_mark
    numbers = [text for fields in below for text in table.wanted(fields)]
    decimals = {len(text.partition(mark)[2]) for text in numbers}
    if not in_front and (len(decimals) != 1 or decimals == {0}):
        _refuse(table, start, start)
    return Heading(start + 1, first)


def _other_width(table: Table, start: int) -> list[str]:
    """Headings of another number than the columns: R names no row names, LabVIEW a comment."""
    names = table.fields(start - 1)
    if len(names) == table.width + 1 and names[-1].lower() == "comment":
        return names[:-1]
    below = [line for _, line in table.rows[start : start + 3]]
    firsts = [table.dialect.split(line)[0].strip() for line in below]
    quoted = all(line.lstrip().startswith('"') for line in below)
    if len(names) == table.width - 1 and all(names):
        if quoted or firsts == ["1", "2", "3"]:
            return ["", *names]
        if table.fields(start)[-1] == "":
            return [*names, ""]
    return []


def _in_comments(table: Table, start: int) -> tuple[list[str], list[str]]:
    """Names, and units below them, in the last two comments above the numbers."""
    above = [line for number, line in table.comments if number < table.rows[start][0]][-2:]
    texts = [line.strip().lstrip("".join(COMMENT_MARKS)).strip() for line in above]
    split = [[text.strip() for text in table.dialect.split(line)] for line in texts]
    fitting = [
        len(fields) == table.width and not any(map(table.dialect.is_value, fields))
        for fields in split
    ]
    if len(split) == 2 and all(fitting) and is_unit_row(split[1]):
        return split[0], _bare_units(split[1])
    return (split[-1], []) if fitting and fitting[-1] else ([], [])


def _stated(table: Table, wanted: set[str], header_lines: int) -> Heading:
    """The headings above the line that the configuration states. The lowest row with all names
    asked for; without names the lowest that holds no units."""
    start = next((i for i, row in enumerate(table.rows) if row[0] > header_lines), None)
    if start is None:
        problem = f"there is no row below the {header_lines} header lines"
        raise InputError(str(table.path), problem, "correct header_lines")
    fields = [table.fields(i) for i in range(start)]
    fitting = [i for i, field in enumerate(fields) if len(field) == table.width and any(field)]
    named = [i for i in fitting if wanted <= set(fields[i])]
    if len(named) > 1 and not wanted and is_unit_row(fields[named[-1]]):
        named.pop()
    if named:
        lowest = named[-1]
        below = fields[lowest + 1] if lowest + 1 in fitting else []
        return Heading(start, fields[lowest], _bare_units(below) if is_unit_row(below) else [])
    if start and table.kind(start - 1) == "other":
        return Heading(start, _other_width(table, start))
    return Heading(start, *_in_comments(table, start))


def _refuse(table: Table, index: int, start: int) -> NoReturn:
    number, line = table.rows[index]
    above = max(number, table.rows[start][0] - 1)
    problem = f'the row "{line.strip()[:40]}" may be a heading or a sample'
    remedy = (
        "repair or remove it, or set header_lines to the number of lines above the first sample"
        f" ({above} if this row is none)"
    )
    raise InputError(str(table.path), problem, remedy, f"line {number}")


def is_unit_row(fields: Sequence[str]) -> bool:
    """Whether the fields are units: known ones, in brackets, or empty, but not all empty."""
    filled = [text for text in fields if text and text != "-"]
    return bool(filled) and all(
        UNIT.fullmatch(text)
        or (_BRACKETED.fullmatch(text) and text[1:-1].strip().lower() not in _NO_VALUE - {"-"})
        for text in filled
    )


def _bare_units(fields: Sequence[str]) -> list[str]:
    return [text.strip("[]()").strip() for text in fields]
