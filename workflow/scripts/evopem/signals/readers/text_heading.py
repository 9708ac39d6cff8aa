"""Where the numbers of a text table begin, and the headings and units above them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from evopem.errors import InputError
from evopem.signals.readers.channels import UNIT, Reference
from evopem.signals.readers.text_dialect import COMMENT_MARKS, Dialect, Lines, Row

_NO_VALUE = {
    "-", "--", "---", "?", "*", "n/a", "na", "nan", "nil", "none", "null", "missing", "invalid",
    "bad", "err", "error", "ol", "ovld", "over", "overflow", "overload", "overrange", "ovrng",
    "saturated", "underflow", "underrange",
}  # fmt: skip
"""What instruments write in place of a number, in lower case."""

_NEARLY_NUMBER = re.compile(r"(?=.*\d)[+-]?[\d.,][\d.,:;/_ '’%exEX+-]*")
"""A number that is spoilt, or a time of day."""

_BRACKETED = re.compile(r"\[[^\[\]]*\]|\([^()]*\)")


@dataclass(frozen=True)
class Heading:
    """What stands above the numbers of a table."""

    start: int  # index of the first row of numbers among the rows
    names: Sequence[str] = ()  # one text a column, or none
    units: Sequence[str] = ()


def find_heading(
    path: Path,
    lines: Lines,
    sample: Sequence[Row],
    dialect: Dialect,
    width: int,
    references: Sequence[Reference],
    header_lines: int | None = None,
) -> Heading:
    """Find the first row of numbers, the names of the columns and their units.

    Headings are the row of texts directly above, or above a row of units, else the last comment
    with a text for each column. Every other row between might be a sample and is refused, unless
    `header_lines` counts it.
    """
    search = _Search(path, lines.rows, dialect, width, _value_columns(sample, dialect, width))
    if header_lines is not None:
        return search.stated(lines.comments, header_lines, references)
    start = next((i for i in range(len(lines.rows)) if search.kind(i) == "numbers"), None)
    if start is None:
        remedy = "write one row a sample, separated by commas, semicolons, tabs or blanks"
        raise InputError(str(path), "holds no row of numbers", remedy, f"line {lines.rows[0][0]}")
    if search.counts_columns(start):
        return search.numbered_columns(start, sample)
    return search.found(lines.comments, start, references)


def _value_columns(sample: Sequence[Row], dialect: Dialect, width: int) -> list[bool]:
    """Of each column, whether most of its fields that are not empty are numbers or dates."""
    score = [0] * width
    for _, line in sample:
        fields = dialect.split(line)
        if len(fields) == width:
            for column, text in enumerate(fields):
                if text.strip():
                    score[column] += 1 if dialect.is_value(text) else -1
    return [value > 0 for value in score]


@dataclass(frozen=True)
class _Search:
    path: Path
    rows: Sequence[Row]
    dialect: Dialect
    width: int
    value_columns: Sequence[bool]

    def fields(self, index: int) -> list[str]:
        """The fields of a row, without the one that a closing separator adds."""
        fields = [text.strip() for text in self.dialect.split(self.rows[index][1])]
        return fields[:-1] if len(fields) == self.width + 1 and not fields[-1] else fields

    def kind(self, index: int) -> str:
        """One of numbers, text, mixed, empty, and "other" for another number of fields."""
        return self._kind(self.fields(index))

    def _kind(self, fields: Sequence[str]) -> str:
        if len(fields) != self.width:
            return "other"
        wanted = self._wanted(fields)
        filled = [text for text in wanted if text]
        values = sum(map(self.dialect.is_value, filled))
        if not filled:
            return "text" if any(fields) else "empty"
        if values == 0:
            return "text"
        return "numbers" if values == len(filled) and 2 * values > len(wanted) else "mixed"

    def counts_columns(self, start: int) -> bool:
        """Whether the first row numbers the columns: 0, 1, … or 1, 2, …, maybe after a blank."""
        fields = self.fields(start)
        if self.width < 2 or len(self.rows) < start + 2:
            return False
        if any(self.kind(i) == "text" for i in range(start)):
            return False
        counted = fields if fields[0] else fields[1:]
        return any(counted == [str(base + i) for i in range(len(counted))] for base in (0, 1))

    def numbered_columns(self, start: int, sample: Sequence[Row]) -> Heading:
        """Headings 0, 1, …, where the numbers below are certainly written in another way."""
        below = [
            self.dialect.split(line) for number, line in sample if number != self.rows[start][0]
        ]
        below = [fields for fields in below if len(fields) == self.width]
        first = self.fields(start)
        numbers = [
            text.strip()
            for fields in below
            for text, held in zip(fields, self.value_columns, strict=True)
            if held
        ]
        decimals = {len(text.partition(self.dialect.decimal_mark)[2]) for text in numbers}
        in_front = bool(below) and not first[0] and all(fields[0].strip() for fields in below)
        if not in_front and (len(decimals) != 1 or decimals == {0}):
            self._refuse(start, "may hold the numbers of the columns", start)
        return Heading(start + 1, first)

    def found(
        self, comments: Sequence[Row], start: int, references: Sequence[Reference]
    ) -> Heading:
        """The headings above the row that was found to be the first of numbers."""
        if start == 0:
            return Heading(start, *self._in_comments(comments, start))
        above = self.fields(start - 1)
        kind = self._kind(above)
        if kind == "other":
            return self._below_other_row(start)
        if kind == "empty":
            self._refuse(start - 1, "is empty", start)
        if kind == "mixed":
            self._refuse(start - 1, "holds numbers beside texts or empty fields", start)
        if start > 1 and is_unit_row(above) and self.kind(start - 2) in ("text", "mixed"):
            return Heading(start, self.fields(start - 2), _bare_units(above))
        if not any(reference in above for reference in references if isinstance(reference, str)):
            self._refuse_damaged_sample(above, start)
        self._refuse_second_heading(start)
        return Heading(start, above)

    def _below_other_row(self, start: int) -> Heading:
        """The headings above numbers that follow a row with another number of fields."""
        above = self.fields(start - 1)
        names = self._other_width(start)
        if names:
            return Heading(start, names)
        if any(self.kind(i) == "text" and all(self._wanted(self.fields(i))) for i in range(start)):
            self._refuse(start - 1, "stands between the headings and the numbers", start)
        if all(self._may_replace_number(text) for text in above if text):
            self._refuse(
                start - 1, f"has {len(above)} fields where the others have {self.width}", start
            )
        return Heading(start)

    def _refuse_damaged_sample(self, above: Sequence[str], start: int) -> None:
        """Refuse a row of texts that no one names and that may be a damaged first sample."""
        filled = [text for text in above if text]
        if len(filled) > 1 and len(set(filled)) == 1:
            self._refuse(start - 1, "has the same text in all columns", start)
        for text in self._wanted(above):
            if self._may_replace_number(text):
                self._refuse(start - 1, f'has "{text}" where the others have a number', start)

    def _may_replace_number(self, text: str) -> bool:
        spoilt = _NEARLY_NUMBER.fullmatch(text) is not None
        return spoilt or text.lower() in _NO_VALUE or self.dialect.is_number(text)

    def _wanted(self, fields: Sequence[str]) -> list[str]:
        """The fields in the columns of numbers."""
        return [text for text, held in zip(fields, self.value_columns, strict=True) if held]

    def _refuse_second_heading(self, start: int) -> None:
        """Refuse two full rows of texts above each other, of which the second holds no units."""
        if start < 2 or self.rows[start - 2][0] + 1 != self.rows[start - 1][0]:
            return
        if self.kind(start - 2) == "text" and all(self._wanted(self.fields(start - 2))):
            self._refuse(start - 1, "is a second row of texts that are not known as units", start)

    def _other_width(self, start: int) -> list[str]:
        """Headings of another number than the columns: R names no row names, LabVIEW a comment."""
        names = self.fields(start - 1)
        if len(names) == self.width + 1 and names[-1].lower() == "comment":
            return names[:-1]
        below = self.rows[start : start + 3]
        firsts = [self.dialect.split(line)[0].strip() for _, line in below]
        quoted = all(line.lstrip().startswith('"') for _, line in below)
        if len(names) == self.width - 1 and all(names):
            if quoted or firsts == ["1", "2", "3"]:
                return ["", *names]
            if self.fields(start)[-1] == "":
                return [*names, ""]
        return []

    def _in_comments(self, comments: Sequence[Row], start: int) -> tuple[list[str], list[str]]:
        """Names, and units below them, in the last two comments above the numbers."""
        above = [row for row in comments if row[0] < self.rows[start][0]][-2:]
        texts = [line.strip().lstrip("".join(COMMENT_MARKS)).strip() for _, line in above]
        split = [[text.strip() for text in self.dialect.split(line)] for line in texts]
        fitting = [self._is_heading(fields) for fields in split]
        if len(split) == 2 and all(fitting) and is_unit_row(split[1]):
            return split[0], _bare_units(split[1])
        return (split[-1], []) if fitting and fitting[-1] else ([], [])

    def _is_heading(self, fields: Sequence[str]) -> bool:
        return len(fields) == self.width and not any(map(self.dialect.is_value, fields))

    def stated(
        self, comments: Sequence[Row], header_lines: int, references: Sequence[Reference]
    ) -> Heading:
        """The headings above the line that the configuration states.

        The lowest row with all names asked for; without names the lowest that holds no units.
        """
        start = next((i for i, row in enumerate(self.rows) if row[0] > header_lines), None)
        if start is None:
            problem = f"there is no row below the {header_lines} header lines"
            raise InputError(str(self.path), problem, "correct header_lines")
        wanted = {reference for reference in references if isinstance(reference, str)}
        fitting = [i for i in range(start) if len(self.fields(i)) == self.width]
        fitting = [i for i in fitting if any(self.fields(i))]
        named = [i for i in fitting if wanted <= set(self.fields(i))]
        if named and not wanted and len(named) > 1 and is_unit_row(self.fields(named[-1])):
            named.pop()
        if named:
            below = next((self.fields(i) for i in fitting if i == named[-1] + 1), [])
            units = _bare_units(below) if is_unit_row(below) else []
            return Heading(start, self.fields(named[-1]), units)
        if start and self.kind(start - 1) == "other":
            return Heading(start, self._other_width(start))
        return Heading(start, *self._in_comments(comments, start))

    def _refuse(self, index: int, problem: str, start: int) -> NoReturn:
        shown = self.rows[index][1].strip()[:40]
        above = max(self.rows[index][0], self.rows[start][0] - 1)
        problem = f'the row "{shown}" {problem}, so it may be a heading or a sample'
        remedy = (
            "repair or remove it, or set header_lines to the number of lines above the first"
            f" sample ({above} if this row is none)"
        )
        raise InputError(str(self.path), problem, remedy, f"line {self.rows[index][0]}")


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
