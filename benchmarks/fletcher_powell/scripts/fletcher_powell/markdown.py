"""The tables and hypotheses of the comparison as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from evopem.report.numbers import fixed, is_number
from fletcher_powell.hypotheses import Hypothesis
from fletcher_powell.page import COMMAND, study_rows
from fletcher_powell.settings import Settings

if TYPE_CHECKING:
    import pandas as pd

Row = Mapping[Any, Any]
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
    parts = [
        "# Searches on the Fletcher-Powell function",
        f"Written by `{COMMAND}`; `benchmarks/fletcher_powell/README.md` says what is compared. "
        "Expected evaluations: all evaluations over the number of runs that reached f < 1e-6. One "
        "family of functions, which says nothing of the choice of a model.",
        f"## n = {settings.dimension}, {settings.evaluations} evaluations, finite differences",
        "P = log10 f at the end.",
        _table(
            study_rows(summary, "table"),
            LABEL,
            ("solved", lambda row: f"{row['successes']}/{row['runs']}"),
            ("mean P", lambda row: fixed(row["P_mean"])),
            ("chapter", lambda row: _number(row["chapter_mean"], fixed)),
            ("expected evaluations", _expected),
        ),
        "## Growth with the dimension, analytic gradients",
        "Expected evaluations by n; a gradient counts one. Default search and least squares "
        "know the residuals.",
        _by_dimension(study_rows(summary, "scale"), _expected),
        "## The best of them, with more runs",
        "Expected evaluations, with 95 % bootstrap intervals.",
        _by_dimension(study_rows(summary, "contest"), _expected_with_interval),
        "## Hypotheses",
        _verdicts(hypotheses),
    ]
    return "\n\n".join(parts) + "\n"


def _by_dimension(rows: Sequence[Row], cell: Callable[[Row], str]) -> str:
    """One row for each algorithm that ran in every dimension, one column for each dimension."""
    dimensions = sorted({row["dimension"] for row in rows})
    algorithms: dict[str, dict[int, Row]] = {}
    for row in rows:
        algorithms.setdefault(row["label"], {})[row["dimension"]] = row
    rows_of_page = [
        {"label": label, **{n: cell(found) for n, found in each.items()}}
        for label, each in algorithms.items()
        if len(each) == len(dimensions)
    ]
    return _table(rows_of_page, LABEL, *((str(n), itemgetter(n)) for n in dimensions))


def _verdicts(hypotheses: Sequence[Hypothesis]) -> str:
    """How many hypotheses hold, and in full those that do not."""
    verdicts = [each.holds for each in hypotheses]
    rejected = [vars(each) for each in hypotheses if each.holds is False]
    counts = (
        f"{verdicts.count(True)} hold, {verdicts.count(None)} are undecided and {len(rejected)} do "
        "not hold; `report.html` lists all with their numbers."
    )
    if not rejected:
        return counts
    table = _table(
        rejected,
        ("does not hold", lambda row: row["statement"]),
        ("numbers", lambda row: row["evidence"]),
    )
    return f"{counts}\n\n{table}"


def _number(value: float, shown: Callable[[float], str]) -> str:
    return shown(value) if is_number(value) else "–"


def _expected(row: Row) -> str:
    return _number(row["expected_evaluations"], _whole)


def _expected_with_interval(row: Row) -> str:
    low, high = row["expected_evaluations_low"], row["expected_evaluations_high"]
    return f"{_expected(row)} ({_number(low, _whole)}…{_number(high, _whole)})"


def _whole(value: float) -> str:
    return f"{value:.0f}"


LABEL: Column = ("algorithm", lambda row: row["label"])


def _table(rows: Sequence[Row], *columns: Column) -> str:
    lines = [[name for name, _ in columns], ["---"] * len(columns)]
    lines += [[str(value(row)) for _, value in columns] for row in rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
