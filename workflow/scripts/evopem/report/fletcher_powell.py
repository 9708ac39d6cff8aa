"""The page on the Fletcher-Powell function: tables, claims and figures of the comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from evopem import __version__
from evopem.figures.fletcher_powell import COMPARISON_FIGURES, Comparison
from evopem.fletcher_powell.algorithms import ALGORITHMS
from evopem.fletcher_powell.experiments import CHAPTER, HYBRIDS
from evopem.report.downloads import csv_download
from evopem.report.inline_svg import inline_svg
from evopem.report.numbers import count, fixed, is_number
from evopem.report.page import environment
from evopem.report.provenance import installed, listed

if TYPE_CHECKING:
    import pandas as pd

LIBRARIES = ("numpy", "scipy", "cma", "optproblems")
COMMAND = "snakemake --cores all fletcher_powell"
VERDICTS = {True: "Holds", False: "Does not hold", None: "Undecided"}


def build_comparison(
    results: Comparison,
    claims: Sequence[Mapping[str, Any]],
    figures: Mapping[str, str],
    settings: Mapping[str, Any],
    template_directory: Path,
) -> str:
    """Build the page.

    Parameters
    ----------
    results : Comparison
    claims : sequence of mapping
        ``statement``, ``holds`` and ``evidence`` of each.
    figures : mapping of str to str
        SVG texts by the figures' names.
    settings : mapping
        The completed ``fletcher_powell`` of the configuration.
    template_directory : Path
        Where ``fletcher_powell.html.j2`` is.

    Returns
    -------
    str
        One HTML page that needs no other file.
    """
    summary = results.summary
    table = _rows(summary, "table")
    template = environment(template_directory).get_template("fletcher_powell.html.j2")
    return template.render(
        settings=settings,
        hybrid=next((row for row in table if row["algorithm"] == "hybrid"), None),
        precise=next((r for r in _rows(summary, "precise") if r["algorithm"] == "hybrid"), None),
        chapter=[row for row in table if row["algorithm"] in CHAPTER],
        today=[row for row in table if row["algorithm"] not in {*CHAPTER[1:], *HYBRIDS[1:]}],
        mutation=[
            row
            for study in ("table", "precise", "scale")
            for row in _rows(summary, study)
            if row["algorithm"] in HYBRIDS and _all_choices(summary, row)
        ],
        scale=[row for row in _rows(summary, "scale") if row["algorithm"] not in HYBRIDS[1:]],
        claims=claims,
        verdicts=VERDICTS,
        classes={True: "passed", False: "failed", None: "unjudged"},
        sections=[
            {
                "id": entry.name,
                "title": entry.title,
                "caption": entry.caption,
                "data": entry.data,
                "download": csv_download(entry.table(results), "fletcher-powell", entry.name),
                "svg": inline_svg(figures[entry.name], entry.name, entry.title),
            }
            for entry in COMPARISON_FIGURES
        ],
        algorithms=[
            algorithm for name, algorithm in ALGORITHMS.items() if name in set(summary["algorithm"])
        ],
        versions=listed({"evopem": __version__, **installed(LIBRARIES)}),
        command=COMMAND,
        configuration=yaml.safe_dump(
            {"fletcher_powell": dict(settings)}, sort_keys=False, default_flow_style=None
        ),
    )


def _rows(summary: pd.DataFrame, study: str) -> list[dict[str, Any]]:
    """Rows of a study, what is missing as None."""
    chosen = summary[summary["study"] == study]
    return [
        {key: None if value != value else value for key, value in row.items()}
        for row in chosen.to_dict("records")
    ]


def _all_choices(summary: pd.DataFrame, row: Mapping[str, Any]) -> bool:
    """Whether all four choices were run where this row was."""
    same = summary[(summary["study"] == row["study"]) & (summary["dimension"] == row["dimension"])]
    return set(HYBRIDS) <= set(same["algorithm"])


def comparison_markdown(
    summary: pd.DataFrame, claims: Sequence[Mapping[str, Any]], settings: Mapping[str, Any]
) -> str:
    """The tables and claims as Markdown.

    Parameters
    ----------
    summary : pandas.DataFrame
        As in ``table.csv``.
    claims, settings
        As for :func:`build_comparison`.
    """
    n = settings["dimension"]
    parts = [
        "# The hybrid on the Fletcher-Powell function",
        f"Written by `{COMMAND}`; what is compared, and how, stands in "
        "[fletcher_powell.md](../fletcher_powell.md).",
        f"## n = {n}, {settings['evaluations']} evaluations, gradients by finite differences",
        "P = log10 f at the end. Expected evaluations to success: all evaluations over the number "
        "of runs that reached f < 1e-6, with 95 % bootstrap interval.",
        _markdown_table(
            (
                "algorithm",
                "runs",
                "solved",
                "mean P",
                "least",
                "largest",
                "chapter: mean (least … largest)",
                "expected evaluations",
            ),
            [
                (
                    row["label"],
                    row["runs"],
                    row["successes"],
                    f"{fixed(row['P_mean'])} ± {fixed(row['P_standard_error'])}",
                    fixed(row["P_min"]),
                    fixed(row["P_max"]),
                    f"{fixed(row['chapter_mean'])} ({fixed(row['chapter_min'])} … "
                    f"{fixed(row['chapter_max'])})"
                    if is_number(row["chapter_mean"])
                    else "",
                    _expected(row),
                )
                for row in _rows(summary, "table")
            ],
        ),
        f"## n = {n}, analytic gradients, each counted one",
        _markdown_table(
            (
                "algorithm",
                "runs",
                "solved",
                "mean P",
                "largest",
                "expected evaluations",
                "the same, counting n a gradient",
            ),
            [
                (
                    row["label"],
                    row["runs"],
                    row["successes"],
                    fixed(row["P_mean"]),
                    fixed(row["P_max"]),
                    _expected(row),
                    count(row["expected_if_differences"]),
                )
                for row in _rows(summary, "precise")
            ],
        ),
        "## Growth with the dimension, analytic gradients, stopped at the target",
        _markdown_table(
            (
                "n",
                "algorithm",
                "runs",
                "solved",
                "expected evaluations",
                "the same, counting n a gradient",
            ),
            [
                (
                    row["dimension"],
                    row["label"],
                    row["runs"],
                    row["successes"],
                    _expected(row),
                    count(row["expected_if_differences"]),
                )
                for row in _rows(summary, "scale")
            ],
        ),
        "## Claims",
        _markdown_table(
            ("claim", "", "evidence"),
            [(each["statement"], VERDICTS[each["holds"]], each["evidence"]) for each in claims],
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _expected(row: Mapping[str, Any]) -> str:
    if not is_number(row["expected_evaluations"]):
        return "–"
    low, high = count(row["expected_evaluations_low"]), row["expected_evaluations_high"]
    high = count(high) if is_number(high) else "∞"
    return f"{count(row['expected_evaluations'])} ({low} … {high})"


def _markdown_table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)
