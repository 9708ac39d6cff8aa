"""Lines of a text table, its separator and decimal mark, and the refusal of ambiguous ones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from evopem.errors import InputError

COMMENT_MARKS = ("#", "%", "//", "!")
MAX_HEADING_LINES = 5
"""A quoted field may extend over at most this many lines, as headings of spreadsheets do."""

Row = tuple[int, str]
"""Line number, counted from 1, and text of the line."""

_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_SPREADSHEET_ERROR = re.compile(
    r"#(N/A|NV|DIV/0!|REF!|VALUE!|WERT!|NAME\?|NUM!|ZAHL!|NULL!|BEZUG!|SPILL!|CALC!|GETTING_DATA"
    r"|####*)",
    re.IGNORECASE,
)
_SEPARATOR_LINE = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
_OPENING_QUOTE = re.compile(r'(^|[,;\t])\s*"')


@dataclass(frozen=True)
class Lines:
    """The lines of a text file, sorted by what they are."""

    # lines that are neither blank nor comments: preamble, headings and samples
    rows: list[Row] = field(default_factory=list)
    # lines that begin with one of `COMMENT_MARKS`
    comments: list[Row] = field(default_factory=list)
    blanks: list[int] = field(default_factory=list)  # numbers of the blank lines
    separator: str | None = None  # the separator that a first line such as ``sep=;`` states


def read_lines(path: Path) -> Lines:
    """Read a text file and sort its lines, without rows of separators alone at the end."""
    text = _decode(path).replace("\r\n", "\n").replace("\r", "\n")
    lines = Lines(separator=_stated_separator(text))
    numbered = list(enumerate(text.split("\n"), start=1))
    if lines.separator is not None:
        del numbered[0]
    if '"' in text:
        numbered = _join_quoted(numbered)
    for number, line in numbered:
        bare = line.strip()
        if not bare and "\t" not in line:
            lines.blanks.append(number)
        elif bare.startswith(COMMENT_MARKS) and not _SPREADSHEET_ERROR.match(bare):
            lines.comments.append((number, line))
        else:
            lines.rows.append((number, line))
    while lines.rows and not lines.rows[-1][1].strip(",;\t "):
        lines.rows.pop()
    if not lines.rows:
        raise InputError(str(path), "holds no rows of numbers", "export the recording again")
    return lines


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
    found = _CONTROL.search(text)
    if found:
        problem = "is not a text file"
        remedy = "give it the extension of its real format or export it as text"
        raise InputError(
            str(path), problem, remedy, f"line {text.count(chr(10), 0, found.start()) + 1}"
        )
    return text


def _stated_separator(text: str) -> str | None:
    """The separator that Excel reads from a first line such as ``sep=;``."""
    found = _SEPARATOR_LINE.fullmatch(text[: text.find("\n")].strip(" ") if "\n" in text else "")
    return found.group(1) if found else None


def _join_quoted(numbered: list[Row]) -> list[Row]:
    """Join lines that a quoted field with line breaks extends over.

    A quotation mark that the next lines do not close is left alone: it may mean inches.
    """
    joined: list[Row] = []
    index = 0
    while index < len(numbered):
        number, line = numbered[index]
        index += 1
        if line.count('"') % 2 and _OPENING_QUOTE.search(line):
            following = numbered[index : index + MAX_HEADING_LINES - 1]
            closing = next(
                (count for count, (_, text) in enumerate(following, 1) if text.count('"') % 2), 0
            )
            line = " ".join([line, *(text for _, text in following[:closing])])
            index += closing
        joined.append((number, line))
    return joined


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
    """The separator and decimal mark under which most fields are numbers, where they are not given.

    On a tie a decimal point comes before a comma, and tab, semicolon, comma in this order; blanks
    only where no other separator makes most fields numbers.
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

    Commas before groups of three digits everywhere; points alike, beside whole numbers in fields
    that are separated by semicolons, as where 1.234 is a thousand.
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
        problem = f'"{marked[0][:40]}" may mean a decimal {kind} or a thousands separator'
        remedy = (
            f'set decimal_mark: "{mark}" if it is the decimal mark, else export the numbers without'
            " thousands separators"
        )
        raise InputError(str(path), problem, remedy, f"column {column + 1}")


def refuse_split_decimals(
    path: Path, first: Row, above: Row | None, dialect: Dialect, sample: Sequence[Row], width: int
) -> None:
    """Refuse a comma-separated table without headings whose commas seem to mark decimals too.

    Of whole numbers in an even number of columns: the line above has half as many fields, or fields
    are such as "-0" and "05", or every other comma is followed by a blank.
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
        problem = "the comma seems to be both the separator and the decimal mark"
        remedy = "export the table with semicolons or with decimal points"
        raise InputError(str(path), problem, remedy, f"line {first[0]}")
