"""The page of the comparison: tables, hypotheses, figures and settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from evopem.files.json_form import to_json
from evopem.report.figures import csv_download, inline_svg
from evopem.report.page import installed, listed
from evopem.report.templates import environment
from evopem.version import __version__
from fletcher_powell.algorithms import ALGORITHMS
from fletcher_powell.experiments import CHAPTER, HYBRIDS
from fletcher_powell.figures import COMPARISON_FIGURES
from fletcher_powell.hypotheses import Hypothesis
from fletcher_powell.settings import Settings
from fletcher_powell.statistics import STUDIES
from fletcher_powell.tables import Tables

if TYPE_CHECKING:
    import pandas as pd

TEMPLATE = Path(__file__).parents[2] / "templates" / "report.html.j2"
LIBRARIES = ("numpy", "scipy", "cma", "optproblems")
COMMAND = "snakemake --cores all fletcher_powell"
VERDICTS = {True: "Holds", False: "Does not hold", None: "Undecided"}
CLASSES = {True: "passed", False: "failed", None: "unjudged"}


def build_page(
    tables: Tables,
    hypotheses: Sequence[Hypothesis],
    figures: Mapping[str, str],
    settings: Settings,
    product_templates: Path,
) -> str:
    """Build the page.

    Parameters
    ----------
    tables : Tables
    hypotheses : sequence of Hypothesis
    figures : mapping of str to str
        SVG texts by the names of the figures.
    settings : Settings
    product_templates : Path
        Folder of the product's templates, whose parts and style sheet the page shares.

    Returns
    -------
    str
        One HTML page that needs no other file.
    """
    summary = tables.summary
    table = study_rows(summary, "table")
    template = environment(product_templates).from_string(TEMPLATE.read_text(encoding="utf-8"))
    return template.render(
        settings=settings,
        hybrid=_row_of(table, "hybrid"),
        precise=_row_of(study_rows(summary, "precise"), "hybrid"),
        chapter=[row for row in table if row["algorithm"] in CHAPTER],
        baselines=[row for row in table if row["algorithm"] not in {*CHAPTER[1:], *HYBRIDS[1:]}],
        refinement=[
            row
            for study in STUDIES
            for row in study_rows(summary, study)
            if row["algorithm"] in HYBRIDS and _all_choices(summary, row)
        ],
        scale=[row for row in study_rows(summary, "scale") if row["algorithm"] not in HYBRIDS[1:]],
        contest=study_rows(summary, "contest"),
        hypotheses=hypotheses,
        verdicts=VERDICTS,
        classes=CLASSES,
        sections=[
            {
                "id": entry.name,
                "title": entry.title,
                "caption": entry.caption,
                "data": entry.data,
                "download": csv_download(entry.table(tables), "fletcher-powell", entry.name),
                "svg": inline_svg(figures[entry.name], entry.name, entry.title),
            }
            for entry in COMPARISON_FIGURES
        ],
        algorithms=[
            algorithm for name, algorithm in ALGORITHMS.items() if name in set(summary["algorithm"])
        ],
        versions=listed({"evopem": __version__, **installed(LIBRARIES)}),
        command=COMMAND,
        configuration=yaml.safe_dump(to_json(settings), sort_keys=False, default_flow_style=None),
    )


def study_rows(summary: pd.DataFrame, study: str) -> list[dict[str, Any]]:
    """Rows of a study for a template, with None for missing values."""
    chosen = summary[summary["study"] == study]
    return [
        {key: None if value != value else value for key, value in row.items()}
        for row in chosen.to_dict("records")
    ]


def _row_of(rows: Sequence[dict[str, Any]], algorithm: str) -> dict[str, Any] | None:
    return next((row for row in rows if row["algorithm"] == algorithm), None)


def _all_choices(summary: pd.DataFrame, row: Mapping[str, Any]) -> bool:
    """Whether all four choices of offspring were run in the study and dimension of a row."""
    same = summary[(summary["study"] == row["study"]) & (summary["dimension"] == row["dimension"])]
    return set(HYBRIDS) <= set(same["algorithm"])
