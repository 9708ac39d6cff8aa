"""Charts of modes over the recordings of a structure, as drawing instructions for SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from evopem.report.numbers import THIN, number
from evopem.results.followed_modes import NORMAL_95, FollowedMode

WIDTH, HEIGHT, EDGE = 640, 90, 4
# A chart with fewer recordings says no more than the table.
FEWEST = 3


@dataclass(frozen=True)
class FollowedChart:
    """Frequency of one mode by recording."""

    title: str
    high: str  # frequencies in Hz at the upper and the lower edge
    low: str
    first: str  # places at the left and the right edge
    last: str
    intervals: str  # SVG paths of 95 % intervals, levels, estimates and those that a warning names
    levels: str
    points: str
    marks: str
    label: str  # description for screen readers


def followed_charts(followed: Sequence[FollowedMode]) -> list[FollowedChart]:
    """Charts of the modes that enough recordings have."""
    several = len({each.group for each in followed}) > 1
    return [_chart(each, several) for each in followed if len(each.modes) >= FEWEST]


def movements(followed: FollowedMode) -> list[str]:
    """Where a mode moved by more than its error, a sentence each."""
    if followed.levels is None:
        return []
    found = []
    for change in followed.levels.changes:
        percent = 100.0 / change.before
        step, error = percent * (change.after - change.before), percent * change.standard_error
        name = followed.recordings[change.index]
        found.append(
            f"The mode at {number(change.before)} Hz moved by {number(step, 3)}{THIN}% "
            f"(standard error {number(error, 2)}{THIN}%) from {name} on."
        )
    for index in followed.levels.outlying:
        level = followed.levels.values[index]
        percent = 100.0 * (followed.modes[index].frequency_hz / level - 1.0)
        found.append(
            f"The mode at {number(level)} Hz lies {number(percent, 3)}{THIN}% from its level in "
            f"{followed.recordings[index]} alone."
        )
    return found


def _chart(followed: FollowedMode, several: bool) -> FollowedChart:
    values = [mode.frequency_hz for mode in followed.modes]
    halves = [NORMAL_95 * mode.frequency_se_hz for mode in followed.modes]
    low = min(value - half for value, half in zip(values, halves, strict=True))
    high = max(value + half for value, half in zip(values, halves, strict=True))
    first, last = followed.places[0], followed.places[-1]
    xs = [
        EDGE + (WIDTH - 2 * EDGE) * (p - first) / ((last - first) or 1.0) for p in followed.places
    ]

    def y(value: float) -> float:
        return EDGE + (HEIGHT - 2 * EDGE) * (high - value) / ((high - low) or 1.0)

    intervals = "".join(
        f"M{x:.1f} {y(value - half):.1f}V{y(value + half):.1f}"
        for x, value, half in zip(xs, values, halves, strict=True)
    )
    points = [f"M{x:.1f} {y(value):.1f}h0" for x, value in zip(xs, values, strict=True)]
    levels, marked = "", set()
    if followed.levels is not None:
        marked = {*(change.index for change in followed.levels.changes), *followed.levels.outlying}
        steps = [
            f"{x:.1f} {y(level):.1f}" for x, level in zip(xs, followed.levels.values, strict=True)
        ]
        levels = "M" + "L".join(steps)
    warnings = movements(followed)
    title = f"Mode {followed.number}, {number(followed.frequency_hz)} Hz"
    return FollowedChart(
        title=f"{followed.group}: {title}" if several else title,
        high=number(high, 5),
        low=number(low, 5),
        first=_edge(followed, 0),
        last=_edge(followed, -1),
        intervals=intervals,
        levels=levels,
        points="".join(points),
        marks="".join(points[index] for index in sorted(marked)),
        label=f"{title}, in {len(values)} recordings from {number(min(values), 5)} to "
        f"{number(max(values), 5)} Hz. {' '.join(warnings) or 'It did not move.'}",
    )


def _edge(followed: FollowedMode, index: int) -> str:
    """Name and place of a recording at an edge of the chart."""
    return f"{followed.recordings[index]} ({number(followed.places[index])})"
