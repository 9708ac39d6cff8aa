"""Lines of a text table, its separator and decimal mark, and the refusal of ambiguous ones."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from evopem.errors import InputError

COMMENT_MARKS = ("#", "%", "//", "!")
MAX_HEADING_LINES = 5
"""A quoted field may extend over at most this many lines, as headings of spreadsheets do."""
SAMPLED_ROWS = 200
"""At most about this many rows decide on separator, decimal mark and number of columns."""
MIN_SHARE_OF_VALUES = 0.9
"""Where a separator makes more fields than this share numbers, blanks do not separate fields."""

Row = tuple[int, str]  # line number, counted from 1, and text of the line

_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_SPREADSHEET_ERROR = re.compile(
    r"#(N/A|NV|DIV/0!|REF!|VALUE!|WERT!|NAME\?|NUM!|ZAHL!|NULL!|BEZUG!|SPILL!|CALC!|GETTING_DATA"
    r"|####*)",
    re.IGNORECASE,
)
_SEPARATOR_LINE = re.compile(r' *"?sep=([^"\s]|\t)"? *\n', re.IGNORECASE)
"""The first line from which Excel takes the separator."""
_OPENING_QUOTE = re.compile(r'(^|[,;\t])\s*"')
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.I)
_CLOCK = r"\d?\d:\d\d:\d\d([.,]\d+)?"
_DATE = re.compile(
    r"\d{4}([-/])\d\d\1\d\d([T ]\d\d:\d\d(:\d\d([.,]\d+)?)?)?(Z|[+-]\d\d:?\d\d)?"
    rf"|(\d\d\.\d\d\.\d{{4}} +)?{_CLOCK}"
)
_COMMA_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_POINT_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}")
_WHOLE = re.compile(r"[+-]?\d+")
_BLANK_SEPARATED = re.compile(r'"([^"]*)"|(\S+)')


class Dialect(NamedTuple):
    """How the fields of a row are separated and numbers are written."""

    separator: str | None  # None stands for any run of blanks and tabs
    decimal_mark: str  # "." or ","

    def split(self, line: str) -> list[str]:
        """The fields of a line. A field in double quotation marks may hold separators."""
        if '"' not in line:
            return line.split() if self.separator is None else line.split(self.separator)
        if self.separator is None:
            return [first or second for first, second in _BLANK_SEPARATED.findall(line)]
        try:
            return next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))
        except csv.Error:  # a field of more than 131,072 characters
            return [line]

    def number(self, text: str) -> str:
        """The text of a number in Python's notation."""
        spelled = text.strip().replace("D", "E").replace("d", "e")
        return spelled.replace(",", ".") if self.decimal_mark == "," else spelled

    def is_number(self, text: str) -> bool:
        """Whether a field is a number; the spellings of NaN and infinity count as numbers."""
        if self.decimal_mark == ",":
            text = text.replace(".", "_").replace(",", ".")
        return _NUMBER.fullmatch(text.strip()) is not None

    def is_value(self, text: str) -> bool:
        """Whether a field is a number or a date."""
        return self.is_number(text) or is_date(text)


def is_date(text: str) -> bool:
    """Whether a field is a date by ISO 8601, a time of day, or one behind a date with points."""
    return _DATE.fullmatch(text.strip()) is not None


def iso_date(text: str) -> str:
    """A date or time of day in the notation of ISO 8601; a time of day is that of a first day."""
    text = text.strip().replace(",", ".").replace("/", "-")
    *day, clock = text.split()
    if "-" in text or ":" not in clock:
        return text
    date = "-".join(reversed(day[0].split("."))) if day else "1970-01-01"
    return f"{date}T{clock if clock[2] == ':' else f'0{clock}'}"


@dataclass(frozen=True)
class Table:
    """The lines of a text file, sorted by what they are, and how they are divided into fields."""

    path: Path
    rows: list[Row]  # lines that are neither blank nor comments: preamble, headings and samples
    comments: list[Row]  # lines that begin with one of `COMMENT_MARKS`
    blanks: list[int]  # numbers of the blank lines
    dialect: Dialect
    width: int  # fields of a row
    sample: list[list[str]]  # fields of rows in the lower half of the file

    @cached_property
    def value_columns(self) -> list[bool]:
        """Of each column, whether most of its fields that are not empty are numbers or dates."""
        filled = [
            [text for text in column if text.strip()] for column in zip(*self.sample, strict=True)
        ]
        return [2 * sum(map(self.dialect.is_value, texts)) > len(texts) for texts in filled]

    def fields(self, index: int) -> list[str]:
        """The fields of a row, without the one that a closing separator adds."""
        fields = [text.strip() for text in self.dialect.split(self.rows[index][1])]
        return fields[:-1] if len(fields) == self.width + 1 and not fields[-1] else fields

    def wanted(self, fields: Sequence[str]) -> list[str]:
        """The fields in the columns of numbers."""
        return [text for text, held in zip(fields, self.value_columns, strict=True) if held]

    def kind(self, index: int) -> str:
        """One of numbers, text, mixed, empty, and "other" for another number of fields."""
        fields = self.fields(index)
        if len(fields) != self.width:
            return "other"
        wanted = self.wanted(fields)
        filled = [text for text in wanted if text]
        values = sum(map(self.dialect.is_value, filled))
        if values == 0:
            return "text" if any(fields) else "empty"
        return "numbers" if values == len(filled) and 2 * values > len(wanted) else "mixed"


def read_table(path: Path, decimal_mark: str | None = None) -> Table:
    """Read a text file and sort its lines, without rows of separators alone at the end."""
    text = _decode(path).replace("\r\n", "\n").replace("\r", "\n")
    numbered = list(enumerate(text.split("\n"), start=1))
    stated = _SEPARATOR_LINE.match(text)
    if stated:
        del numbered[0]
    if '"' in text:
        numbered = _join_quoted(numbered)
    rows: list[Row] = []
    comments: list[Row] = []
    blanks: list[int] = []
    for number, line in numbered:
        bare = line.strip()
        if not bare and "\t" not in line:
            blanks.append(number)
        elif bare.startswith(COMMENT_MARKS) and not _SPREADSHEET_ERROR.match(bare):
            comments.append((number, line))
        else:
            rows.append((number, line))
    while rows and not rows[-1][1].strip(",;\t "):
        rows.pop()
    if not rows:
        raise InputError(str(path), "holds no rows of numbers", "export the recording again")
    # Headings stand in the upper half; the last row may be cut short.
    lower = rows[len(rows) // 2 : -1] or rows[-1:]
    sample = [line for _, line in lower[:: max(1, len(lower) // SAMPLED_ROWS)]]
    dialect = _choose_dialect(sample, stated and stated.group(1), decimal_mark)
    split = [dialect.split(line) for line in sample]
    width = Counter(map(len, split)).most_common(1)[0][0]
    usual = [fields for fields in split if len(fields) == width]
    return Table(path, rows, comments, blanks, dialect, width, usual)


def _decode(path: Path) -> str:
    data = path.read_bytes()
    # Programs for DOS end a text file with Ctrl-Z.
    data = data.removesuffix(b"\x1a")
    wide = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        # Instruments write units such as m/s² in an 8-bit code. All of these codes share ASCII,
        # and with it the numbers.
        text = data.decode("latin-1")
    control = _CONTROL.search(text)
    if control:
        remedy = "give it the extension of its real format or export it as text"
        place = f"line {text.count(chr(10), 0, control.start()) + 1}"
        raise InputError(str(path), "is not a text file", remedy, place)
    return text


def _join_quoted(numbered: list[Row]) -> list[Row]:
    """Join lines that a quoted field with line breaks extends over. A quotation mark that the next
    lines do not close is left alone: it may mean inches."""
    joined: list[Row] = []
    index = 0
    while index < len(numbered):
        number, line = numbered[index]
        index += 1
        if line.count('"') % 2 and _OPENING_QUOTE.search(line):
            following = [text for _, text in numbered[index : index + MAX_HEADING_LINES - 1]]
            closing = next((n for n, text in enumerate(following, 1) if text.count('"') % 2), 0)
            line = " ".join([line, *following[:closing]])
            index += closing
        joined.append((number, line))
    return joined


def _choose_dialect(
    sample: Sequence[str], separator: str | None, decimal_mark: str | None
) -> Dialect:
    """The separator and decimal mark under which most fields are numbers, where they are not given.
    On a tie a decimal point comes before a comma, and tab, semicolon, comma in this order; blanks
    only where no other separator makes most fields numbers."""
    quoted = any('"' in line for line in sample)
    decimals = (decimal_mark,) if decimal_mark else (".", ",")
    choices = [
        Dialect(mark, decimal)
        for decimal in decimals
        for mark in ((separator,) if separator else ("\t", ";", ","))
        # A comma can be both only where quotation marks hold the numbers together.
        if not (mark == "," and decimal == "," and not quoted)
    ] or [Dialect(separator, decimals[0])]

    def share_of_values(dialect: Dialect) -> float:
        fields = [text for line in sample for text in dialect.split(line) if text.strip()]
        return sum(map(dialect.is_value, fields)) / max(1, len(fields))

    best = max(choices, key=share_of_values)
    if separator or share_of_values(best) > MIN_SHARE_OF_VALUES:
        return best
    return max([best, *(Dialect(None, decimal) for decimal in decimals)], key=share_of_values)


def refuse_ambiguous_thousands(table: Table, fields: Sequence[str], column: int) -> None:
    """Refuse fields such as 1,234, and 1.234 beside whole numbers where semicolons separate."""
    mark = table.dialect.decimal_mark
    marked = [text.strip() for text in fields if mark in text]
    whole = [text.strip() for text in fields if mark not in text]
    if mark == ",":
        pattern, kind = _COMMA_THOUSANDS, "comma"
    elif table.dialect.separator == ";" and whole and all(map(_WHOLE.fullmatch, whole)):
        pattern, kind = _POINT_THOUSANDS, "point"
    else:
        return
    if marked and all(map(pattern.fullmatch, marked)):
        problem = f'"{marked[0][:40]}" may mean a decimal {kind} or a thousands separator'
        remedy = (
            f'set decimal_mark: "{mark}" if it is the decimal mark, else export the numbers without'
            " thousands separators"
        )
        raise InputError(str(table.path), problem, remedy, f"column {column + 1}")


def refuse_split_decimals(table: Table, start: int) -> None:
    """Refuse a comma-separated table without headings whose commas seem to mark decimals too.

    Of whole numbers in an even number of columns: the line above has half as many fields, or fields
    are such as "-0" and "05", or every other comma is followed by a blank.
    """
    rows, width = table.sample, table.width
    if table.dialect != (",", ".") or width % 2 or any("." in text for row in rows for text in row):
        return
    halved = start > 0 and len(table.rows[start - 1][1].split(",")) * 2 == width
    odd = any(
        fields[place].strip() in {"-0", "+0"} or re.fullmatch(r"0\d+", fields[place + 1].strip())
        for fields in rows
        for place in range(0, width, 2)
    )
    blanks = {tuple(text.startswith(" ") for text in fields[1:]) for fields in rows}
    paired = width > 2 and blanks == {tuple(place % 2 == 1 for place in range(width - 1))}
    if halved or odd or paired:
        problem = "the comma seems to be both the separator and the decimal mark"
        remedy = "export the table with semicolons or with decimal points"
        raise InputError(str(table.path), problem, remedy, f"line {table.rows[start][0]}")
