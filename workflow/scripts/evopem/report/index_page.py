"""The page that lists all data sets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from evopem.report.templates import environment
from evopem.results.fleet import DatasetSummary, Entry


@dataclass(frozen=True)
class IndexRow:
    """A row of the page.

    Attributes
    ----------
    name : str
    href : str
        Relative address of the data set's page; of its logs where its results are not complete.
    problem : str
        Why the results are not complete; empty where they are.
    orders : str
    prediction_error_percent, simulation_error_percent : float
        NaN where not known.
    passed, failed, not_judged : int
        Numbers of checks.
    concerns : tuple of str
        Names of the checks that failed or could not be judged.
    """

    name: str
    href: str
    problem: str = ""
    orders: str = ""
    prediction_error_percent: float = math.nan
    simulation_error_percent: float = math.nan
    passed: int = 0
    failed: int = 0
    not_judged: int = 0
    concerns: tuple[str, ...] = ()

    @property
    def rank(self) -> tuple[bool, int, int, float, str]:
        """Rows with a smaller rank come first."""
        error = self.simulation_error_percent
        severity = math.inf if math.isnan(error) else error
        return (not self.problem, -self.failed, -self.not_judged, -severity, self.name)


def build_index(
    entries: Mapping[str, Entry], template_directory: Path, page: str = "report.html"
) -> str:
    """Build the page that lists all data sets.

    Data sets without complete results come first, then those with failed checks, then those with
    checks that could not be judged, then by decreasing simulation error.

    Parameters
    ----------
    entries : mapping of str to DatasetSummary or IncompleteDataset
        By the names of the data sets.
    template_directory : Path
        Folder of ``index.html.j2``.
    page : str
        The file in the folder of a data set that its row links to.

    Returns
    -------
    str
        One HTML page.
    """
    rows = sorted(
        (_row(name, entry, page) for name, entry in entries.items()), key=lambda row: row.rank
    )
    return environment(template_directory).get_template("index.html.j2").render(rows=rows)


def _row(name: str, entry: Entry, page: str) -> IndexRow:
    folder = quote(name, safe="")
    if not isinstance(entry, DatasetSummary):
        return IndexRow(name, f"{folder}/logs/", problem=entry.problem)
    return IndexRow(
        name,
        f"{folder}/{page}",
        orders=str(entry.orders),
        prediction_error_percent=entry.prediction_error_percent,
        simulation_error_percent=entry.simulation_error_percent,
        passed=entry.n_checks(passed=True),
        failed=entry.n_checks(passed=False),
        not_judged=entry.n_checks(passed=None),
        concerns=tuple(check.name for check in entry.checks if check.passed is not True),
    )
