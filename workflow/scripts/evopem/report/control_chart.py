"""Control charts: damage indices over the recordings, their limit, and who lies above it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from evopem.report.numbers import THIN, count, enumeration, number, plural

if TYPE_CHECKING:
    import pandas as pd

# Size of the charts of recordings, and what is left free at their edges.
WIDTH, HEIGHT, EDGE = 640, 90, 4
# Lowest index that is drawn; names that a sentence lists.
LOWEST, LISTED = 0.1, 20


def damage_sentences(table: pd.DataFrame, false_alarms: float) -> list[str]:
    """What the damage indices say, for each structure: who is above the limit, who not judged."""
    several = table["group"].nunique() > 1
    return [
        f"{group}: {sentence}" if several else sentence
        for group, rows in table.groupby("group", sort=False)
        for sentence in _sentences(rows, false_alarms)
    ]


def damage_headline(table: pd.DataFrame) -> str:
    """How many of the recordings that are judged lie above the limit."""
    judged = table.loc[~table["reference"].astype(bool), "damage_index"].dropna()
    exceeding = int((judged > 1.0).sum())
    if judged.empty:
        return "No recording is judged by its damage index"
    amount = f"{exceeding or 'None'} of {plural(len(judged), 'recording')}"
    return f"{amount} {'lie' if exceeding > 1 else 'lies'} above the limit of the damage index"


def _sentences(table: pd.DataFrame, false_alarms: float) -> Iterator[str]:
    known, reference = table["damage_index"].notna(), table["reference"].astype(bool)
    above = known & (table["damage_index"] > 1.0)
    judged, exceeding = int((known & ~reference).sum()), table[above & ~reference]
    if judged:
        share = f"{number(100.0 * false_alarms)}{THIN}%"
        names = f": {_named(exceeding)}" if len(exceeding) else ""
        yield (
            f"{damage_headline(table)}{names}. At its false-alarm rate of {share},"
            f" {number(false_alarms * judged, 2)} of them are expected there by chance."
        )
    if (above & reference).any():
        yield f"Of the reference itself, {_named(table[above & reference])} lie above it."
    if not (missing := table[table["missing_modes"].notna() & ~reference]).empty:
        cells = zip(missing["dataset"], missing["missing_modes"].astype(str), strict=True)
        lacking = [
            f"mode {', '.join(modes.removesuffix('.0').split())} in {name}" for name, modes in cells
        ]
        rare = f"fewer than 5{THIN}% of the unchanged recordings lack them"
        yield f"Modes not found: {_listed(lacking)}; {rare}."
    for reason, rows in table[~known & ~reference].groupby("not_judged"):
        yield f"Not judged, because {reason}: {_listed(rows['dataset'].tolist())}."


def _named(rows: pd.DataFrame) -> str:
    """Recordings with the mode that lies farthest away."""
    cells = rows[["dataset", "farthest_mode", "change_percent"]].itertuples(index=False)
    return _listed([f"{n} (mode {int(m)} by {number(change, 2)}{THIN}%)" for n, m, change in cells])


def _listed(names: list[str]) -> str:
    left = len(names) - LISTED
    return enumeration([*names[:LISTED], *([f"{count(left)} more"] if left > 0 else [])])


def damage_charts(table: pd.DataFrame) -> list[dict[str, str]]:
    """The chart of each structure, on a logarithmic scale: SVG paths, and words at their edges."""
    known = table[table["damage_index"].notna()]
    groups = known.groupby("group", sort=False)
    return [_chart(str(group), rows, groups.ngroups > 1) for group, rows in groups]


def across(places: Sequence[float]) -> list[str]:
    """Where recordings stand across a chart, of ascending places."""
    scale = (WIDTH - 2 * EDGE) / ((places[-1] - places[0]) or 1.0)
    return [f"{EDGE + scale * (place - places[0]):.1f}" for place in places]


def _chart(group: str, rows: pd.DataFrame, several: bool) -> dict[str, str]:
    indices = rows["damage_index"].clip(lower=LOWEST)
    high, low = max(2.0, float(indices.max())), min(0.5, float(indices.min()))
    up = (HEIGHT - 2 * EDGE) / math.log(high / low)
    points = [
        f"M{x} {EDGE + up * math.log(high / index):.1f}h0"
        for x, index in zip(across(rows["place"].tolist()), indices, strict=True)
    ]
    above = (rows["damage_index"] > 1.0).tolist()
    names = [f"{rows['dataset'].iloc[k]} ({number(rows['place'].iloc[k])})" for k in (0, -1)]
    limit = f"{EDGE + up * math.log(high):.1f}"
    return {
        "title": f"{group}: damage index" if several else "Damage index",
        "high": number(high, 3),
        "low": number(low, 3),
        "first": names[0],
        "last": names[1],
        "limit": f"M0 {limit}H{WIDTH}",
        "points": "".join(points),
        "reference": "".join(p for p, of in zip(points, rows["reference"], strict=True) if of),
        "marks": "".join(p for p, over in zip(points, above, strict=True) if over),
        "label": f"Damage index of {len(rows)} recordings from {number(float(indices.min()), 2)} to"
        f" {number(float(indices.max()), 3)}; {sum(above)} above the limit of 1.",
    }
