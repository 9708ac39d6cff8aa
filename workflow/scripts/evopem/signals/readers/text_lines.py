"""Lines of a text table: decoding, comments, blank lines and quoted line breaks."""

from __future__ import annotations

import re
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
    """Read a text file and sort its lines.

    An error value of a spreadsheet, such as ``#N/A``, at the beginning of a line is part of a
    row and not a comment. Rows at the end that consist of separators only are left out.
    """
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
        raise InputError(
            str(path),
            "is not a text file",
            "give it the extension of its real format or export it as text",
            f"line {text.count(chr(10), 0, found.start()) + 1}",
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
