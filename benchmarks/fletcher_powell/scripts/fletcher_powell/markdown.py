"""The tables and hypotheses of the comparison as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from evopem.report.numbers import count, fixed, is_number
from fletcher_powell.hypotheses import Hypothesis
from fletcher_powell.page import COMMAND, VERDICTS, study_rows
from fletcher_powell.settings import Settings

if TYPE_CHECKING:
    import pandas as pd

Row = Mapping[str, Any]
Column = tuple[str, Callable[[Row], Any]]


def comparison_markdown(
    summary: pd.DataFrame, hypotheses: Sequence[Hypothesis], settings: Settings
) -> str:
    """Write the tables and hypotheses as Markdown.

    Parameters
    ----------
    summary : DataFrame
        As in ``table.csv``.
    hypotheses : sequence of Hypothesis
    settings : Settings
    """
    n = settings.dimension
    parts = [
        "# Searches on the Fletcher-Powell function",
        f"Written by `{COMMAND}`. [Settings](fletcher_powell_settings.md) describes what is "
        "compared, and how.",
        f"## n = {n}, {settings.evaluations} evaluations, gradients by finite differences",
        "P = log10 f at the end. Expected evaluations to success: all evaluations over the number "
        "of runs that reached f < 1e-6, with 95 % bootstrap interval.",
        _table(
            study_rows(summary, "table"),
            LABEL,
            RUNS,
            SOLVED,
            ("mean P", lambda row: f"{fixed(row['P_mean'])} ± {fixed(row['P_standard_error'])}"),
            ("least", lambda row: fixed(row["P_min"])),
            ("largest", lambda row: fixed(row["P_max"])),
            ("chapter: mean (least … largest)", _chapter),
            ("expected evaluations", _expected),
        ),
        f"## n = {n}, analytic gradients, each counted one",
        _table(
            study_rows(summary, "precise"),
            LABEL,
            RUNS,
            SOLVED,
            ("mean P", lambda row: fixed(row["P_mean"])),
            ("largest", lambda row: fixed(row["P_max"])),
            ("expected evaluations", _expected),
            COUNTING_N,
        ),
        "## Growth with the dimension, analytic gradients, stopped at the target",
        _evaluations(summary, "scale"),
        "## The best of them, with more runs",
        "Analytic gradients, stopped at the target. The default search and the two algorithms on "
        "least squares know the residuals of f: all residuals count as one value, their "
        "derivatives as one gradient.",
        _evaluations(summary, "contest"),
        "## Hypotheses",
        _table(
            [vars(each) for each in hypotheses],
            ("hypothesis", lambda row: row["statement"]),
            ("", lambda row: VERDICTS[row["holds"]]),
            ("evidence", lambda row: row["evidence"]),
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _evaluations(summary: pd.DataFrame, study: str) -> str:
    """Table of a study whose runs end at the target, in several dimensions."""
    return _table(
        study_rows(summary, study),
        ("n", lambda row: row["dimension"]),
        LABEL,
        RUNS,
        SOLVED,
        ("expected evaluations", _expected),
        COUNTING_N,
    )


def _chapter(row: Row) -> str:
    if not is_number(row["chapter_mean"]):
        return ""
    least, largest = fixed(row["chapter_min"]), fixed(row["chapter_max"])
    return f"{fixed(row['chapter_mean'])} ({least} … {largest})"


def _expected(row: Row) -> str:
    if not is_number(row["expected_evaluations"]):
        return "–"
    low, high = count(row["expected_evaluations_low"]), row["expected_evaluations_high"]
    high = count(high) if is_number(high) else "∞"
    return f"{count(row['expected_evaluations'])} ({low} … {high})"


LABEL: Column = ("algorithm", lambda row: row["label"])
RUNS: Column = ("runs", lambda row: row["runs"])
SOLVED: Column = ("solved", lambda row: row["successes"])
COUNTING_N: Column = (
    "the same, counting n a gradient",
    lambda row: count(row["expected_if_differences"]),
)


def _table(rows: Sequence[Row], *columns: Column) -> str:
    lines = [[name for name, _ in columns], ["---"] * len(columns)]
    lines += [[str(value(row)) for _, value in columns] for row in rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
