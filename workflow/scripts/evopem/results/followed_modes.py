"""The same mode over many recordings of one structure, and whether it moved.

Recordings whose names begin alike are taken for one structure.  In their order, each mode is
paired with those followed so far by frequency and, with several outputs, by shape.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from evopem.arrays import Array
from evopem.models.mode_matching import paired
from evopem.models.modes import Mode, assurance
from evopem.models.parameter_covariance import NORMAL_95
from evopem.results.fleet import MODE_COLUMNS, mode_values
from evopem.validation.damage_index import regressors
from evopem.validation.level_changes import (
    FEWEST,
    Drift,
    Levels,
    constant_probability,
    find_drift,
    find_levels,
)

if TYPE_CHECKING:
    import pandas as pd

FALSE_ALARMS = 0.05  # probability of any warning in a whole run where nothing changes
# A mode is the same one within this share of its frequency, or within three standard errors; and
# with at least this modal assurance criterion, where shapes have several entries.
SAME_FREQUENCY = 0.08
STANDARD_ERRORS = 3.0
SAME_SHAPE = 0.5
RECENT = 5  # latest recordings whose median is what a mode of the next one is compared with
FOUND_IN = 0.2  # smallest share of a structure's recordings in which a followed mode is found
# Level at which steps are sought that may describe a change better which is known to be there.
LENIENT = 0.5
# Columns of the frequency at mean conditions, and of its level, trend or oscillation.
FITTED = ("corrected_hz", "level_hz")


@dataclass(frozen=True)
class FollowedMode:
    """One mode in the recordings of a structure that have it."""

    group: str  # what the names of the recordings begin with
    number: int  # from 1, by frequency
    recordings: tuple[str, ...]  # those that have it, in their order
    # Position of each: its number from 1, or the value that the recordings are ordered by
    places: tuple[float, ...]
    modes: tuple[Mode, ...]  # in each recording
    levels: Levels | None  # of the frequency; None for too few recordings
    drift: Drift | None  # of the frequency, where it says more than steps do
    constant: bool  # whether a constant frequency, weighted by the errors, is not rejected
    conditions: Array  # (n, c) that are regressed out, in each recording

    @property
    def frequency_hz(self) -> float:
        """Median frequency."""
        return median(mode.frequency_hz for mode in self.modes)

    @property
    def corrected_hz(self) -> tuple[float, ...]:
        """Frequencies at mean conditions, as far as those explain them."""
        values = [mode.frequency_hz for mode in self.modes]
        explained = self.levels.explained if self.levels else [0.0] * len(values)
        return tuple(value - part for value, part in zip(values, explained, strict=True))


_Track = list[tuple[int, Mode]]  # a mode with the number of each recording that has it


def _level(track: _Track) -> float:
    return median(mode.frequency_hz for _, mode in track)


def group_of(name: str) -> str:
    """What a name begins with: up to its first separator or, without one, to its last letter."""
    head = re.split(r"[-_./ ]", name.strip(), maxsplit=1)[0]
    return re.sub(r"\d+$", "", head) or head or name


def grouped(names: Iterable[str], places: Mapping[str, float]) -> dict[str, list[str]]:
    """The names of each structure, by what they begin with, those with places in their order."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(group_of(name), []).append(name)
    return {g: sorted(of, key=lambda name: places.get(name, 0.0)) for g, of in groups.items()}


def follow_modes(
    recordings: Mapping[str, Sequence[Mode]],
    places: Mapping[str, float] | None = None,
    conditions: Sequence[Mapping[str, float]] = (),
) -> list[FollowedMode]:
    """Recognise the modes of each structure in its recordings, and test whether they moved.

    Only modes with a known standard error are followed.  All tests of all modes together warn with
    a probability of at most :data:`FALSE_ALARMS` where nothing changes.

    ``recordings``: trusted modes by name, in their order where no places are given.  ``places``:
    what the recordings are ordered by.  ``conditions``: what is regressed out, each by recording.
    Returns by group and frequency.
    """
    tracks = []
    for group, names in grouped(recordings, places or {}).items():
        kept = [
            track
            for track in _tracks([recordings[name] for name in names])
            if len(track) >= max(2, math.ceil(FOUND_IN * len(names)))
        ]
        kept.sort(key=_level)
        tracks += [(group, names, number, track) for number, track in enumerate(kept, start=1)]
    tested = sum(len(track) >= FEWEST for *_, track in tracks)
    followed = []
    for group, names, number, track in tracks:
        members = tuple(names[place] for place, _ in track)
        positions = tuple(float(place + 1) for place, _ in track)
        if places is not None:
            positions = tuple(places[name] for name in members)
        modes = tuple(mode for _, mode in track)
        beside = np.array([[values[name] for values in conditions] for name in members])
        course = _course(modes, positions, FALSE_ALARMS / max(tested, 1), beside)
        followed.append(FollowedMode(group, number, members, positions, modes, *course, beside))
    return followed


def followed_table(followed: Sequence[FollowedMode]) -> pd.DataFrame:
    """A row for each mode and recording, with 95 % intervals and what the tests say."""
    import pandas as pd

    table = pd.DataFrame(
        [row for group in followed for row in _rows(group)],
        columns=["group", "mode", "dataset", "place", *MODE_COLUMNS, "mac", *FITTED, "warning"],
    )
    # After the error of each value, its 95 % interval.
    for name, unit in (("frequency", "hz"), ("damping", "percent")):
        half = NORMAL_95 * table[f"{name}_se_{unit}"]
        after = table.columns.get_loc(f"{name}_se_{unit}") + 1
        table.insert(after, f"{name}_low_{unit}", table[f"{name}_{unit}"] - half)
        table.insert(after + 1, f"{name}_high_{unit}", table[f"{name}_{unit}"] + half)
    words = dict.fromkeys(("group", "dataset", "warning"), "string")
    numbers = table.columns.difference([*words, "mode"])
    return table.astype(words | {"mode": "Int64"} | dict.fromkeys(numbers, "float64"))


def _rows(followed: FollowedMode) -> Iterator[tuple[object, ...]]:
    levels, first = followed.levels, followed.modes[0].shape
    warnings: dict[int, str] = {}
    if levels is not None:
        warnings = dict.fromkeys(levels.outlying, "away from its level")
        warnings |= {change.index: "moved from here on" for change in levels.changes}
    if followed.drift is not None:
        warnings[0] = f"{followed.drift.kind} from here on"
    for index, (name, place, mode) in enumerate(
        zip(followed.recordings, followed.places, followed.modes, strict=True)
    ):
        yield (
            *(followed.group, followed.number, name, place, *mode_values(mode)),
            assurance(first, mode.shape) if len(first) > 1 else math.nan,
            followed.corrected_hz[index],
            math.nan if levels is None else levels.values[index],
            warnings.get(index),
        )


def _course(
    modes: Sequence[Mode], places: Sequence[float], significance: float, conditions: Array
) -> tuple[Levels | None, Drift | None, bool]:
    """Levels, drift and constancy; half of the significance is for either of the first two."""
    values = np.array([mode.frequency_hz for mode in modes])
    errors = np.array([mode.frequency_se_hz for mode in modes])
    every = np.ones(len(modes), dtype=bool)
    terms, _ = regressors(conditions, every, values[:, None], errors[:, None])
    covariates = [*(terms - terms.mean(axis=0)).T[1:]]
    constant = constant_probability(values, errors, covariates) >= significance
    if len(modes) < FEWEST:
        return None, None, constant
    levels = find_levels(values, errors, 0.5 * significance, covariates)
    drift = find_drift(values, errors, np.array(places), 0.5 * significance, covariates)
    if drift is not None:
        count = math.log(len(modes))
        steps = levels if levels.changes else find_levels(values, errors, LENIENT, covariates)
        of_steps = _left(values, errors, steps) + 2 * len(steps.changes) * count
        of_drift = _left(values, errors, drift) + (1 + 2 * (drift.kind != "trend")) * count
        # A step is part of a trend and a trend of steps: the better description is said (BIC).
        if steps.changes and of_steps < of_drift:
            levels, drift = steps, None
        else:
            levels = Levels(drift.values, levels.scatter, (), (), drift.explained)
    return levels, drift, constant


def _left(values: Array, errors: Array, fitted: Levels | Drift) -> float:
    left = values - np.array(fitted.values) - np.array(fitted.explained)
    return float(np.sum((left / errors) ** 2))


def _tracks(recordings: Sequence[Sequence[Mode]]) -> list[_Track]:
    """Modes paired from recording to recording; one that fits none begins a new track."""
    tracks: list[_Track] = []
    for place, modes in enumerate(recordings):
        usable = [mode for mode in modes if 0.0 < mode.frequency_se_hz < math.inf]
        distances = np.array([[_distance(track, mode) for track in tracks] for mode in usable])
        known = paired(np.where(distances <= 1.0, distances, np.inf)) if distances.size else {}
        for index, mode in enumerate(usable):
            if index not in known:
                tracks.append([])
            tracks[known.get(index, -1)].append((place, mode))
    return tracks


def _distance(track: _Track, mode: Mode) -> float:
    """Distance of a mode from the latest ones of a track; above 1 it is another one."""
    level = _level(track[-RECENT:])
    error = median(estimate.frequency_se_hz for _, estimate in track[-RECENT:])
    allowed = max(SAME_FREQUENCY * level, STANDARD_ERRORS * math.hypot(error, mode.frequency_se_hz))
    distance = abs(mode.frequency_hz - level) / allowed
    last = track[-1][1].shape
    if len(last) < 2 or len(last) != len(mode.shape):
        return distance
    lost = (1.0 - assurance(last, mode.shape)) / (1.0 - SAME_SHAPE)
    # Close modes are distinguished by their shapes, far ones by their frequencies.
    return lost if lost > 1.0 else 0.5 * (distance + lost) if distance <= 1.0 else distance
