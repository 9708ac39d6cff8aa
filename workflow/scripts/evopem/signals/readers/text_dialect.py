"""Separator and decimal mark of a text table, and the refusal of ambiguous ones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from evopem.errors import InputError
from evopem.signals.readers.text_lines import Row

MIN_SHARE_OF_VALUES = 0.9
"""Where a separator makes more fields than this share numbers, blanks do not separate fields."""

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.I)
_DATE = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d([.,]\d+)?)?)?(Z|[+-]\d\d:?\d\d)?")
_COMMA_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_POINT_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}")
_WHOLE = re.compile(r"[+-]?\d+")
_BLANK_SEPARATED = re.compile(r'"([^"]*)"|(\S+)')


@dataclass(frozen=True)
class Dialect:
    """How the fields of a row are separated and numbers are written."""

    separator: str | None  # None stands for any run of blanks and tabs
    decimal_mark: str  # "." or ","

    def split(self, line: str) -> list[str]:
        """The fields of a line. A field in double quotation marks may hold separators."""
        if '"' in line:
            return self._split_quoted(line)
        return line.split() if self.separator is None else line.split(self.separator)

    def _split_quoted(self, line: str) -> list[str]:
        if self.separator is None:
            return [first or second for first, second in _BLANK_SEPARATED.findall(line)]
        separator = re.escape(self.separator)
        quoted = re.compile(rf' *"((?:[^"]|"")*+)" *(?={separator}|$)')
        fields = []
        start = 0
        while True:
            found = quoted.match(line, start)
            if found:
                fields.append(found.group(1).replace('""', '"'))
                end = found.end()
            else:
                end = line.find(self.separator, start)
                end = len(line) if end < 0 else end
                fields.append(line[start:end])
            if end >= len(line):
                return fields
            start = end + len(self.separator)

    def number(self, text: str) -> str:
        """The text of a number in Python's notation."""
        spelled = text.strip().replace("D", "E").replace("d", "e")
        return spelled.replace(",", ".") if self.decimal_mark == "," else spelled

    def is_number(self, text: str) -> bool:
        """Whether a field is a number; the spellings of NaN and infinity count as numbers."""
        text = text.strip()
        if self.decimal_mark == ",":
            if "." in text:
                return False
            text = text.replace(",", ".")
        return _NUMBER.fullmatch(text) is not None

    def is_value(self, text: str) -> bool:
        """Whether a field is a number or a date."""
        return self.is_number(text) or is_date(text)


def is_date(text: str) -> bool:
    """Whether a field is a date in the notation of ISO 8601."""
    return _DATE.fullmatch(text.strip()) is not None


def choose_dialect(
    sample: Sequence[Row], separator: str | None = None, decimal_mark: str | None = None
) -> Dialect:
    """The separator and decimal mark under which most fields are numbers.

    On a tie a decimal point comes before a decimal comma, and tab, semicolon, comma, blanks
    follow in this order. Blanks are taken only where no other separator makes most fields
    numbers, so that blanks within a single field do not decide on the whole table.

    A separator or decimal mark that is known already is given.
    """
    quoted = any('"' in line for _, line in sample)
    decimals = (decimal_mark,) if decimal_mark else (".", ",")
    marks = (separator,) if separator else ("\t", ";", ",")
    choices = [
        Dialect(mark, decimal)
        for decimal in decimals
        for mark in marks
        # A comma can be both only where quotation marks hold the numbers together.
        if not (mark == "," and decimal == "," and not quoted)
    ] or [Dialect(separator, decimals[0])]

    def share_of_values(dialect: Dialect) -> float:
        fields = [text for _, line in sample for text in dialect.split(line) if text.strip()]
        return sum(map(dialect.is_value, fields)) / max(1, len(fields))

    best = max(choices, key=share_of_values)
    if separator or share_of_values(best) > MIN_SHARE_OF_VALUES:
        return best
    return max([best, *(Dialect(None, decimal) for decimal in decimals)], key=share_of_values)


def refuse_ambiguous_thousands(
    path: Path, fields: Sequence[str], dialect: Dialect, column: int
) -> None:
    """Refuse a column in which a mark may separate thousands as well as decimals.

    Commas are ambiguous when every number with a comma has groups of three digits after it.
    Points are when, in addition, other numbers of the column are whole and fields are separated
    by semicolons, as in the countries that write 1.234 for a thousand.
    """
    mark = dialect.decimal_mark
    pattern = _COMMA_THOUSANDS if mark == "," else _POINT_THOUSANDS
    marked = [text.strip() for text in fields if mark in text]
    if not marked or not all(map(pattern.fullmatch, marked)):
        return
    whole = len(marked) < len(fields) and all(
        _WHOLE.fullmatch(text.strip()) for text in fields if mark not in text
    )
    if mark == "," or (dialect.separator == ";" and whole):
        kind = "comma" if mark == "," else "point"
        raise InputError(
            str(path),
            f'"{marked[0][:40]}" may mean a decimal {kind} or a thousands separator',
            f'set decimal_mark: "{mark}" if it is the decimal mark, else export the numbers without'
            " thousands separators",
            f"column {column + 1}",
        )


def refuse_split_decimals(
    path: Path, first: Row, above: Row | None, dialect: Dialect, sample: Sequence[Row], width: int
) -> None:
    """Refuse a comma-separated table without headings whose commas seem to mark decimals too.

    The signs, in a table of whole numbers with an even number of columns: the line above it has
    half as many fields; or there are fields such as "-0" before and "05" after a comma; or the
    same commas in every row are followed by a blank, and others are not.
    """
    if dialect.separator != "," or dialect.decimal_mark != "." or width % 2:
        return
    rows = [dialect.split(line) for _, line in sample]
    rows = [fields for fields in rows if len(fields) == width]
    if any("." in text for fields in rows for text in fields):
        return
    halved = above is not None and len(above[1].split(",")) * 2 == width
    odd = any(
        fields[place].strip() in {"-0", "+0"} or re.fullmatch(r"0\d+", fields[place + 1].strip())
        for fields in rows
        for place in range(0, width, 2)
    )
    blanks = {tuple(text.startswith(" ") for text in fields[1:]) for fields in rows}
    paired = width > 2 and blanks == {tuple(place % 2 == 1 for place in range(width - 1))}
    if halved or odd or paired:
        raise InputError(
            str(path),
            "the comma seems to be both the separator and the decimal mark",
            "export the table with semicolons or with decimal points",
            f"line {first[0]}",
        )
