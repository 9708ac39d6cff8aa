"""The same mode over many recordings of one structure, and whether it moved.

Recordings whose names begin alike are taken for one structure.  In their order, each mode is
paired with those followed so far by frequency and, with several outputs, by shape.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evopem.models.mode_shapes import assurance
from evopem.models.modes import Mode
from evopem.validation.level_changes import Drift, constant_probability, find_drift
from evopem.validation.level_changes import FEWEST, Levels, find_levels

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

# Probability of any warning in a whole run where nothing changes.
FALSE_ALARMS = 0.05
# A mode is the same one within this share of its frequency, or within three standard errors; and
# with at least this modal assurance criterion, where shapes have several entries.
SAME_FREQUENCY = 0.08
STANDARD_ERRORS = 3.0
SAME_SHAPE = 0.5
# Latest recordings whose median is what a mode of the next one is compared with.
RECENT = 5
# Smallest share of a structure's recordings in which a followed mode is found.
FOUND_IN = 0.2
# Level at which steps are sought that may describe a change better which is known to be there.
LENIENT = 0.5
# Factor of a standard error for a 95 % interval.
NORMAL_95 = 1.959964


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

    @property
    def frequency_hz(self) -> float:
        """Median frequency."""
        return median(mode.frequency_hz for mode in self.modes)


@dataclass
class _Track:
    places: list[int] = field(default_factory=list)
    modes: list[Mode] = field(default_factory=list)

    def add(self, place: int, mode: Mode) -> None:
        self.places.append(place)
        self.modes.append(mode)

    @property
    def frequencies(self) -> list[float]:
        return [mode.frequency_hz for mode in self.modes]


def group_of(name: str) -> str:
    """What a name begins with: up to its first separator or, without one, to its last letter."""
    head = re.split(r"[-_./ ]", name.strip(), maxsplit=1)[0]
    return re.sub(r"\d+$", "", head) or head or name


def follow_modes(
    recordings: Mapping[str, Sequence[Mode]], places: Mapping[str, float] | None = None
) -> list[FollowedMode]:
    """Recognise the modes of each structure in its recordings, and test whether they moved.

    Only modes with a known standard error are followed.  All tests of all modes together warn with
    a probability of at most :data:`FALSE_ALARMS` where nothing changes.

    ``recordings``: trusted modes by name, in their order where no places are given.  ``places``:
    what the recordings are ordered by.  Returns by group and frequency.
    """
    groups: dict[str, list[str]] = {}
    for name in recordings:
        groups.setdefault(group_of(name), []).append(name)
    tracks = []
    for group, names in groups.items():
        if places is not None:
            names = sorted(names, key=lambda name: places[name])
        kept = [
            track
            for track in _tracks([recordings[name] for name in names])
            if len(track.modes) >= max(2, math.ceil(FOUND_IN * len(names)))
        ]
        kept.sort(key=lambda track: median(track.frequencies))
        tracks += [(group, names, number, track) for number, track in enumerate(kept, start=1)]
    tested = sum(len(track.modes) >= FEWEST for *_, track in tracks)
    followed = []
    for group, names, number, track in tracks:
        members = tuple(names[place] for place in track.places)
        positions = [
            float(place + 1) if places is None else places[name]
            for place, name in zip(track.places, members, strict=True)
        ]
        course = _course(track.modes, positions, FALSE_ALARMS / max(tested, 1))
        modes = tuple(track.modes)
        followed.append(FollowedMode(group, number, members, tuple(positions), modes, *course))
    return followed


def followed_table(followed: Sequence[FollowedMode]) -> pd.DataFrame:
    """A row for each mode and recording, with 95 % intervals and what the tests say."""
    import pandas as pd

    rows = [row for each in followed for row in _rows(each)]
    return pd.DataFrame(rows, columns=list(_COLUMN_TYPES)).astype(_COLUMN_TYPES)


_QUANTITIES = tuple(
    f"{name}{end}"
    for name, unit in (("frequency", "_hz"), ("damping", "_percent"))
    for end in (unit, f"_se{unit}", f"_low{unit}", f"_high{unit}")
)
_COLUMN_TYPES = (
    {"group": "string", "mode": "Int64", "dataset": "string"}
    | dict.fromkeys(("place", *_QUANTITIES, "mac", "level_hz"), "float64")
    | {"warning": "string"}
)


def _rows(followed: FollowedMode) -> list[dict[str, object]]:
    levels = followed.levels
    rows = []
    for index, (name, place, mode) in enumerate(
        zip(followed.recordings, followed.places, followed.modes, strict=True)
    ):
        warning = None
        if followed.drift is not None and index == 0:
            warning = f"{followed.drift.kind} from here on"
        elif levels is not None and any(change.index == index for change in levels.changes):
            warning = "moved from here on"
        elif levels is not None and index in levels.outlying:
            warning = "away from its level"
        first = followed.modes[0].shape
        rows.append(
            {"group": followed.group, "mode": followed.number, "dataset": name, "place": place}
            | _interval("frequency", "_hz", mode.frequency_hz, mode.frequency_se_hz)
            | _interval("damping", "_percent", 100.0 * mode.damping_ratio, 100.0 * mode.damping_se)
            | {
                "mac": assurance(first, mode.shape) if len(first) > 1 else math.nan,
                "level_hz": math.nan if levels is None else levels.values[index],
                "warning": warning,
            }
        )
    return rows


def _interval(name: str, unit: str, value: float, error: float) -> dict[str, float]:
    half = NORMAL_95 * error
    values = (value, error, value - half, value + half)
    ends = ("", "_se", "_low", "_high")
    return {f"{name}{end}{unit}": each for end, each in zip(ends, values, strict=True)}


def _course(
    modes: Sequence[Mode], places: Sequence[float], significance: float
) -> tuple[Levels | None, Drift | None, bool]:
    """Levels, drift and constancy; half of the significance is for either of the first two."""
    values = np.array([mode.frequency_hz for mode in modes])
    errors = np.array([mode.frequency_se_hz for mode in modes])
    constant = constant_probability(values, errors) >= significance
    if len(modes) < FEWEST:
        return None, None, constant
    levels = find_levels(values, errors, 0.5 * significance)
    drift = find_drift(values, errors, np.array(places), 0.5 * significance)
    if drift is not None:
        count = math.log(len(modes))
        steps = levels if levels.changes else find_levels(values, errors, LENIENT)
        of_steps = _left(values, errors, steps.values) + 2 * len(steps.changes) * count
        of_drift = _left(values, errors, drift.values) + (1 + 2 * (drift.kind != "trend")) * count
        # A step is part of a trend and a trend of steps: the better description is told (BIC).
        if steps.changes and of_steps < of_drift:
            levels, drift = steps, None
        else:
            levels = Levels(drift.values, levels.scatter, (), ())
    return levels, drift, constant


def _left(values: Array, errors: Array, fitted: Sequence[float]) -> float:
    return float(np.sum(((values - np.array(fitted)) / errors) ** 2))


def _tracks(recordings: Sequence[Sequence[Mode]]) -> list[_Track]:
    """Modes paired from recording to recording; one that fits none begins a new track."""
    from scipy.optimize import linear_sum_assignment

    tracks: list[_Track] = []
    for place, modes in enumerate(recordings):
        usable = [mode for mode in modes if 0.0 < mode.frequency_se_hz < math.inf]
        paired: set[int] = set()
        if tracks and usable:
            distances = np.array([[_distance(track, mode) for track in tracks] for mode in usable])
            # Pairs that are too far apart all have one large cost, so that none displaces another.
            rows, columns = linear_sum_assignment(np.where(distances <= 1.0, distances, 1e3))
            for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
                if distances[row, column] <= 1.0:
                    tracks[column].add(place, usable[row])
                    paired.add(row)
        for index, mode in enumerate(usable):
            if index not in paired:
                tracks.append(_Track([place], [mode]))
    return tracks


def _distance(track: _Track, mode: Mode) -> float:
    """Distance of a mode from the latest ones of a track; above 1 it is another one."""
    level = median(track.frequencies[-RECENT:])
    error = median(each.frequency_se_hz for each in track.modes[-RECENT:])
    allowed = max(SAME_FREQUENCY * level, STANDARD_ERRORS * math.hypot(error, mode.frequency_se_hz))
    distance = abs(mode.frequency_hz - level) / allowed
    last = track.modes[-1].shape
    if len(last) < 2 or len(last) != len(mode.shape):
        return distance
    lost = (1.0 - assurance(last, mode.shape)) / (1.0 - SAME_SHAPE)
    # Close modes are told apart by their shapes, far ones by their frequencies.
    return lost if lost > 1.0 else 0.5 * (distance + lost) if distance <= 1.0 else distance
