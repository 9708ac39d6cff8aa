"""The page that lists all data sets, with charts of their modes and damage indices."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median, stdev
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd

from evopem.config.conditions import Following
from evopem.models.parameter_covariance import NORMAL_95
from evopem.report.comparison import dependence_sentences
from evopem.report.numbers import THIN, count, enumeration, number, plural
from evopem.report.templates import Context, environment, template_folder
from evopem.results.comparison import Dependence
from evopem.results.fleet import DatasetSummary, Entry
from evopem.results.followed_modes import FollowedMode, group_of
from evopem.results.identity import IncompleteDataset

# Size of a row's plot of the gain, and the decibels that it shows at most.
GAIN_WIDTH, GAIN_HEIGHT, DEEPEST = 120, 30, 80.0
# Size of the charts of recordings, and what is left free at their edges.
WIDTH, HEIGHT, EDGE = 640, 90, 4
# Lowest damage index that is drawn; names that a sentence lists.
LOWEST, LISTED = 0.1, 20
NOT_COMPARED = Following()
FEWEST = 3  # with fewer recordings the chart of a followed mode says no more than the table


def build_index(
    entries: Mapping[str, Entry],
    page: str = "report.html",
    followed: Sequence[FollowedMode] = (),
    following: Following = NOT_COMPARED,
    damage: pd.DataFrame | None = None,
    dependences: Sequence[Dependence] = (),
    setups: Sequence[str] = (),
    places: Mapping[str, tuple[str, str]] | None = None,
) -> str:
    """The page that lists all data sets; `page` is the file that a row links to.

    `setups`: structures with a page of their own; `places`: address and group of each data set
    that is not in the folder of the page.

    Data sets without complete results come first, then those with failed checks, then those with
    checks that could not be judged, then by decreasing simulation error."""
    places = places or _places(entries)
    groups = Counter(group for _, group in places.values())
    page_of = environment(template_folder()).get_template("index.html.j2")
    return page_of.render(
        rows=[
            _row(*item, page, *places[item[0]])
            for item in sorted(entries.items(), key=lambda item: _rank(*item))
        ],
        grouped=len(groups) > 1 and max(groups.values()) > 1,
        charts=followed_charts(followed),
        warnings=[sentence for group in followed for sentence in movements(group)],
        varying=[sentence for group in followed for sentence in variation(group)],
        dependences=dependence_sentences(dependences),
        ordered_by=following.order.name if following.order else "",
        corrected=enumeration([*following.corrected]),
        control_charts=[] if damage is None else damage_charts(damage),
        damage=[] if damage is None else damage_sentences(damage, following.false_alarms),
        damage_headline="" if damage is None else damage_headline(damage),
        setups=setups,
    )


def _places(entries: Mapping[str, Entry]) -> dict[str, tuple[str, str]]:
    """The address of each data set, and its group: the folder of its recording. Where the
    recordings lie in one folder, names that begin alike are a group."""
    files = {name: getattr(entry, "file", None) or "" for name, entry in entries.items()}
    folders = {name: Path(file).parent.name for name, file in files.items() if file}
    named = len(set(folders.values())) < 2
    return {
        name: (quote(name, safe=""), group_of(name) if named else folders.get(name, ""))
        for name in entries
    }


def _rank(name: str, entry: Entry) -> tuple[Any, ...]:
    """Data sets with a smaller rank come first."""
    if isinstance(entry, IncompleteDataset):
        return (False, name)
    error = entry.simulation_error_percent
    severity = math.inf if math.isnan(error) else error
    return (True, -len(entry.failed), -entry.n_checks(passed=None), -severity, name)


def _row(name: str, entry: Entry, page: str, folder: str, group: str) -> Context:
    """A row; the address is that of the page or a log."""
    row = {"name": name, "group": group}
    if isinstance(entry, DatasetSummary):
        return row | {"href": f"{folder}/{page}", "summary": entry, "gain": _gain(entry)}
    href = f"{folder}/{quote(entry.log)}" if entry.log else ""
    return row | {"href": href, "problem": entry.problem, "summary": None}


def _gain(summary: DatasetSummary) -> Context | None:
    """The gain over frequency, from its largest value down to at most :data:`DEEPEST` below."""
    gain_db, highest = np.array(summary.gain_db), summary.sampling_rate / 2
    known = gain_db[np.isfinite(gain_db)]
    if known.size < 2:
        return None
    top = float(known.max())
    bottom = max(float(known.min()), top - DEEPEST)
    inside = np.where(np.isfinite(gain_db), np.maximum(gain_db, bottom), bottom)
    xs = GAIN_WIDTH * (np.arange(gain_db.size) + 0.5) / gain_db.size
    ys = 1 + (GAIN_HEIGHT - 2) * (top - inside) / max(top - bottom, 1.0)
    points = [f"{x:.0f} {y:.1f}".replace(".0", "") for x, y in zip(xs, ys, strict=True)]
    marks = [
        f"{GAIN_WIDTH * mode.frequency_hz / highest:.1f}"
        for mode, trusted in zip(summary.modes, summary.trusted, strict=True)
        if trusted and mode.frequency_hz < highest
    ]
    label = f"Gain from 0 to {number(highest)} Hz, from {top:.0f} down to {bottom:.0f} dB"
    return {"path": "M" + "L".join(points), "marks": marks, "label": label.replace("-", "−")}


def followed_charts(followed: Sequence[FollowedMode]) -> list[dict[str, str]]:
    """Charts of the modes that enough recordings have."""
    several = len({group.group for group in followed}) > 1
    return [_chart(group, several) for group in followed if len(group.modes) >= FEWEST]


def movements(followed: FollowedMode) -> list[str]:
    """How a mode moved by more than its error and its scatter, a sentence each."""
    if followed.levels is None:
        return []
    sentences, drift = [], followed.drift
    if drift is not None:
        moved = _moved(followed.frequency_hz, drift.size, drift.standard_error)
        how = f"oscillates by ±{moved} with a period of {number(drift.period, 2)}"
        if drift.kind == "trend":
            first, *_, last = followed.recordings
            how = f"follows a trend: {moved} from {first} to {last}"
        sentences.append(f"The mode at {number(followed.frequency_hz)} Hz {how}.")
    for change in followed.levels.changes:
        moved = _moved(change.before, change.after - change.before, change.standard_error)
        name = followed.recordings[change.index]
        sentences.append(f"The mode at {number(change.before)} Hz moved by {moved} from {name} on.")
    for index in followed.levels.outlying:
        level, value = followed.levels.values[index], followed.modes[index].frequency_hz
        sentences.append(
            f"The mode at {number(level)} Hz lies {_share(value - level, level, 3)} from its level"
            f" in {followed.recordings[index]} alone."
        )
    return sentences


def variation(followed: FollowedMode) -> list[str]:
    """That a mode is not constant within its errors, where nothing says how it moved."""
    if followed.constant or movements(followed):
        return []
    level = followed.frequency_hz
    spread = stdev(mode.frequency_hz for mode in followed.modes)
    error = median(mode.frequency_se_hz for mode in followed.modes)
    return [
        f"The mode at {number(level)} Hz varies by {_share(spread, level)} from recording to"
        f" recording, more than its standard error of {_share(error, level)} explains."
    ]


def _share(part: float, whole: float, digits: int = 2) -> str:
    return f"{number(100.0 * part / whole, digits)}{THIN}%"


def _moved(level: float, size: float, error: float) -> str:
    return f"{_share(size, level, 3)} (standard error {_share(error, level)})"


def _chart(followed: FollowedMode, several: bool) -> dict[str, str]:
    """Frequency of one mode by recording: SVG paths, and the words at their edges."""
    values = followed.corrected_hz
    halves = [NORMAL_95 * mode.frequency_se_hz for mode in followed.modes]
    ends = [(v - half, v + half) for v, half in zip(values, halves, strict=True)]
    low, high = min(low for low, _ in ends), max(high for _, high in ends)
    places = followed.places
    up = (HEIGHT - 2 * EDGE) / ((high - low) or 1.0)
    xs = across(places)

    def ys(of: Sequence[float]) -> list[str]:
        return [f"{EDGE + up * (high - value):.1f}" for value in of]

    bars = zip(xs, *map(ys, zip(*ends, strict=True)), strict=True)
    points = [f"M{x} {y}h0" for x, y in zip(xs, ys(values), strict=True)]
    levels, marked = "", set[int]()
    if followed.levels is not None:
        marked = {*(change.index for change in followed.levels.changes), *followed.levels.outlying}
        steps = zip(xs, ys(followed.levels.values), strict=True)
        levels = "M" + "L".join(f"{x} {y}" for x, y in steps)
    text = " ".join(movements(followed) + variation(followed))
    title = f"Mode {followed.number}, {number(followed.frequency_hz)} Hz"
    spread = f"from {number(min(values), 5)} to {number(max(values), 5)} Hz"
    first, last = (f"{followed.recordings[k]} ({number(places[k])})" for k in (0, -1))
    return {
        "title": f"{followed.group}: {title}" if several else title,
        "high": number(high, 5),
        "low": number(low, 5),
        "first": first,
        "last": last,
        "intervals": "".join(f"M{x} {bottom}V{top}" for x, bottom, top in bars),
        "levels": levels,
        "points": "".join(points),
        "marks": "".join(points[index] for index in sorted(marked)),
        "label": f"{title}, in {len(values)} recordings {spread}."
        f" {text or 'It moved by no more than its error.'}",
    }


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
    groups = table[table["damage_index"].notna()].groupby("group", sort=False)
    return [_damage_chart(str(group), rows, groups.ngroups > 1) for group, rows in groups]


def across(places: Sequence[float]) -> list[str]:
    """Where recordings stand across a chart, of ascending places."""
    scale = (WIDTH - 2 * EDGE) / ((places[-1] - places[0]) or 1.0)
    return [f"{EDGE + scale * (place - places[0]):.1f}" for place in places]


def _damage_chart(group: str, rows: pd.DataFrame, several: bool) -> dict[str, str]:
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
