"""The list of all data sets as an HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, nan
from pathlib import Path
from urllib.parse import quote

from evopem.report.numbers import is_number
from evopem.report.templates import environment
from evopem.results.fleet import Entry, IncompleteDataset


@dataclass(frozen=True)
class IndexRow:
    """One data set in the list.

    Attributes
    ----------
    name, href : str
        Name of the data set, and address of its report, or of its logs where it is not complete.
    problem : str
        Why its results are not complete; empty where they are.
    orders : str
    prediction_error_percent, simulation_error_percent : float
        NaN where not known.
    passed, failed, not_judged : int
        Numbers of checks.
    concerns : tuple of str
        Names of the checks that failed or were not judged.
    """

    name: str
    href: str
    problem: str = ""
    orders: str = ""
    prediction_error_percent: float = nan
    simulation_error_percent: float = nan
    passed: int = 0
    failed: int = 0
    not_judged: int = 0
    concerns: tuple[str, ...] = ()

    @property
    def sort_key(self) -> tuple[bool, int, int, float, str]:
        """Key that sorts the worst data sets first."""
        error = self.simulation_error_percent
        worst = -error if is_number(error) else -inf
        return (not self.problem, -self.failed, -self.not_judged, worst, self.name)


def build_index(
    entries: Mapping[str, Entry], template_directory: Path, page: str = "report.html"
) -> str:
    """Build the list of all data sets, the worst first.

    Parameters
    ----------
    entries : mapping of str to DatasetSummary or IncompleteDataset
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
    rows = sorted(
        (_row(name, entry, page) for name, entry in entries.items()), key=lambda row: row.sort_key
    )
    return environment(template_directory).get_template("index.html.j2").render(rows=rows)


def _row(name: str, entry: Entry, page: str) -> IndexRow:
    folder = quote(name, safe="")
    if isinstance(entry, IncompleteDataset):
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
