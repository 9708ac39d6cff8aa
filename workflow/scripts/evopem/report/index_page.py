"""The list of several data sets as an HTML page."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from evopem.report.numbers import is_number
from evopem.report.templates import environment
from evopem.results.fleet import Summary


@dataclass(frozen=True)
class IndexRow:
    """One data set in the list.

    Attributes
    ----------
    name, href : str
        Name of the data set, and address of its report or of its logs.
    problem : str
        Why it has no model; empty where it has one.
    orders : str
    prediction, simulation : float
        Errors in percent; NaN where not known.
    passed, failed, not_judged : int
        Numbers of checks.
    concerns : tuple of str
        Names of the checks that did not pass.
    """

    name: str
    href: str
    problem: str
    orders: str
    prediction: float
    simulation: float
    passed: int
    failed: int
    not_judged: int
    concerns: tuple[str, ...]

    @property
    def severity(self) -> tuple[bool, int, int, float, str]:
        """Key that sorts the worst first."""
        error = -self.simulation if is_number(self.simulation) else -math.inf
        return (not self.problem, -self.failed, -self.not_judged, error, self.name)


def build_index(
    summaries: Mapping[str, Summary], template_directory: Path, page: str = "report.html"
) -> str:
    """Build the list of several data sets, the worst first.

    Parameters
    ----------
    summaries : mapping of str to Summary
        By the names of the data sets.
    template_directory : Path
        Folder of ``index.html.j2``.
    page : str
        File that each row links to, in the folder of its data set.

    Returns
    -------
    str
        One HTML page.
    """
    rows = [_row(name, summary, page) for name, summary in summaries.items()]
    rows.sort(key=lambda row: row.severity)
    return environment(template_directory).get_template("index.html.j2").render(rows=rows)


def _row(name: str, summary: Summary, page: str) -> IndexRow:
    verdicts = summary.get("checks", {})
    orders = summary.get("orders")
    problem = summary.get("problem") or ""
    outcomes = list(verdicts.values())
    return IndexRow(
        name=name,
        href=f"{quote(name, safe='')}/{'logs/' if problem else page}",
        problem=problem,
        orders="ARMAX({na},{nb},{nc},{nk})".format(**orders) if orders else "",
        prediction=summary.get("prediction_error_percent", math.nan),
        simulation=summary.get("simulation_error_percent", math.nan),
        passed=outcomes.count(True),
        failed=outcomes.count(False),
        not_judged=outcomes.count(None),
        concerns=tuple(check for check, passed in verdicts.items() if passed is not True),
    )
