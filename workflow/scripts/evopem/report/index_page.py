"""The page that lists all data sets."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from evopem.report.followed_chart import followed_charts, movements
from evopem.report.numbers import number, to_its_error
from evopem.report.templates import environment
from evopem.results.fleet import DatasetSummary, Entry
from evopem.results.followed_modes import FollowedMode, group_of

# Size of a row's plot of the gain, and the decibels that it shows at most.
WIDTH, HEIGHT = 120, 30
DEEPEST = 80.0


@dataclass(frozen=True)
class ListedMode:
    """A mode of a row; its text has the digits that its standard error leaves."""

    frequency_hz: float
    text: str
    trusted: bool


@dataclass(frozen=True)
class Sparkline:
    """The gain of a model as a small plot."""

    path: str  # of the gain, in SVG
    marks: list[str]  # abscissae of the trusted modes
    label: str  # description for screen readers


@dataclass(frozen=True)
class IndexRow:
    """A row of the page."""

    name: str
    group: str  # data sets whose names begin alike have one group
    # Relative address of the data set's page; of a log where its results are not complete, and
    # empty where there is none.
    href: str
    problem: str = ""  # why the results are not complete; empty where they are
    orders: str = ""
    prediction_error_percent: float = math.nan  # naN where not known
    simulation_error_percent: float = math.nan
    passed: int = 0  # numbers of checks
    failed: int = 0
    not_judged: int = 0
    # Names of the checks that failed or could not be judged, and of those that failed.
    concerns: tuple[str, ...] = ()
    failed_checks: tuple[str, ...] = ()
    modes: tuple[ListedMode, ...] = ()  # by frequency
    sparkline: Sparkline | None = None

    @property
    def frequencies(self) -> list[float]:
        """Natural frequencies in Hz."""
        return [mode.frequency_hz for mode in self.modes]

    @property
    def rank(self) -> tuple[bool, int, int, float, str]:
        """Rows with a smaller rank come first."""
        error = self.simulation_error_percent
        severity = math.inf if math.isnan(error) else error
        return (not self.problem, -self.failed, -self.not_judged, -severity, self.name)


def build_index(
    entries: Mapping[str, Entry],
    template_directory: Path,
    page: str = "report.html",
    followed: Sequence[FollowedMode] = (),
    ordered_by: str = "",
) -> str:
    """The page that lists all data sets; `page` is the file that a row links to.

    Data sets without complete results come first, then those with failed checks, then those with
    checks that could not be judged, then by decreasing simulation error."""
    rows = sorted(
        (_row(name, entry, page) for name, entry in entries.items()), key=lambda row: row.rank
    )
    sizes = Counter(row.group for row in rows)
    return (
        environment(template_directory)
        .get_template("index.html.j2")
        .render(
            rows=rows,
            grouped=len(sizes) > 1 and max(sizes.values()) > 1,
            charts=followed_charts(followed),
            warnings=[sentence for each in followed for sentence in movements(each)],
            ordered_by=ordered_by,
        )
    )


def _row(name: str, entry: Entry, page: str) -> IndexRow:
    folder, group = quote(name, safe=""), group_of(name)
    if not isinstance(entry, DatasetSummary):
        href = f"{folder}/{quote(entry.log)}" if entry.log else ""
        return IndexRow(name, group, href, problem=entry.problem)
    modes = tuple(
        ListedMode(
            mode.frequency_hz, to_its_error(mode.frequency_hz, mode.frequency_se_hz), trusted
        )
        for mode, trusted in zip(entry.modes, entry.trusted, strict=True)
    )
    return IndexRow(
        name,
        group,
        f"{folder}/{page}",
        orders=entry.model,
        prediction_error_percent=entry.prediction_error_percent,
        simulation_error_percent=entry.simulation_error_percent,
        passed=entry.n_checks(passed=True),
        failed=len(entry.failed),
        not_judged=entry.n_checks(passed=None),
        concerns=tuple(check.name for check in entry.checks if check.passed is not True),
        failed_checks=tuple(check.name for check in entry.failed),
        modes=modes,
        sparkline=_sparkline(entry.gain_db, modes, entry.sampling_rate / 2),
    )


def _sparkline(
    gain_db: Sequence[float], modes: Sequence[ListedMode], highest: float
) -> Sparkline | None:
    """The gain over frequency, from its largest value down to at most :data:`DEEPEST` below."""
    known = [gain for gain in gain_db if math.isfinite(gain)]
    if len(known) < 2:
        return None
    top = max(known)
    bottom = max(min(known), top - DEEPEST)
    span = max(top - bottom, 1.0)
    points = []
    for place, gain in enumerate(gain_db):
        x = WIDTH * (place + 0.5) / len(gain_db)
        inside = max(gain, bottom) if math.isfinite(gain) else bottom
        y = 1 + (HEIGHT - 2) * (top - inside) / span
        points.append(f"{x:.0f} {y:.1f}".replace(".0", ""))
    marks = [
        f"{WIDTH * mode.frequency_hz / highest:.1f}"
        for mode in modes
        if mode.trusted and mode.frequency_hz < highest
    ]
    label = f"Gain from 0 to {number(highest)} Hz, from {top:.0f} down to {bottom:.0f} dB"
    return Sparkline("M" + "L".join(points), marks, label.replace("-", "−"))
