"""The damage index of recordings: how far their modes lie from those of a reference."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from evopem.config.conditions import Following, following_of
from evopem.errors import InputError
from evopem.results.comparison import Dependence
from evopem.results.fleet import DatasetSummary, Entry
from evopem.results.followed_modes import FollowedMode, follow_modes, grouped
from evopem.validation.damage_index import Distance, Frequencies
from evopem.validation.level_changes import FEWEST

if TYPE_CHECKING:
    import pandas as pd

# Columns of the table; the last ones say which mode lies farthest away, what is not judged, and
# which modes are missing that few recordings of the reference lack.
_TYPES = (
    {"group": "string", "dataset": "string", "place": "float64", "reference": "boolean"}
    | {"damage_index": "float64", "p_value": "float64", "above": "boolean", "modes": "string"}
    | {"farthest_mode": "Int64", "change_percent": "float64", "not_judged": "string"}
    | {"missing_modes": "string"}
)
_REASONS = {
    "": "",
    "no mode": "it has no mode of the others",
    "reference": "too few recordings of the reference have its modes",
    "condition": "its conditions lie outside those of the reference",
}


class Results(Protocol):
    """What the index takes of the results of a recording."""

    @property
    def summary(self) -> DatasetSummary:
        """With its modes, and which of them to trust."""
        ...


@dataclass(frozen=True)
class Compared:
    """All data sets, how they are compared, and what comes out, each computed once."""

    entries: Mapping[str, Entry]
    following: Following

    @cached_property
    def followed(self) -> list[FollowedMode]:
        """The trusted modes over the recordings."""
        order, recordings = self.following.order, {}
        for name, entry in self.entries.items():
            if isinstance(entry, DatasetSummary):
                pairs = zip(entry.modes, entry.trusted, strict=True)
                recordings[name] = [mode for mode, trusted in pairs if trusted]
        conditions = [*self.following.corrected.values()]
        return follow_modes(recordings, order.places if order else None, conditions)

    @property
    def dependences(self) -> list[Dependence]:
        """Of the followed modes on standard deviation and mean of the inputs of their recordings.

        Beside conditions that are regressed out.  None of modes in fewer recordings than that and
        :data:`FEWEST`, of recordings with other inputs, and on what goes with a condition.
        """
        tests = []
        for mode in self.followed:
            entries = [self.entries[name] for name in mode.recordings]
            channels = [entry.inputs for entry in entries if isinstance(entry, DatasetSummary)]
            names = {tuple(channel.name for channel in of_entry) for of_entry in channels}
            beside = [values for values in mode.conditions.T if np.ptp(values) > 0.0]
            if len(names) > 1 or len(channels) < FEWEST + len(beside):
                continue
            for of_input in zip(*channels, strict=True):
                for of in ("standard deviation", "mean"):
                    x = np.array([getattr(channel, of.replace(" ", "_")) for channel in of_input])
                    design = np.column_stack([np.ones(len(x)), *beside, x])
                    if np.isfinite(x).all() and np.linalg.matrix_rank(design) == design.shape[1]:
                        level = of_input[0].name, of, x
                        tests.append(Dependence.fitted(*level, mode.modes, beside))
        return tests

    @cached_property
    def damage(self) -> pd.DataFrame:
        """The damage index of each recording."""
        return damage_table(self.followed, self.entries, self.following)


def damage_index(
    recordings: Mapping[str, Results],
    reference: int | str,
    conditions: Mapping[str, Mapping[str, float]] | pd.DataFrame | None = None,
    false_alarms: float = 0.01,
) -> pd.DataFrame:
    """How far each recording of a structure lies from those in which nothing has changed.

    Parameters
    ----------
    recordings : mapping of str to Results
        Those of :func:`evopem.identify` or :func:`evopem.read_results`, in their order.
    reference : int or str
        How many recordings, from the first one on, are unchanged, or a pattern of their names.
    conditions : mapping of str to mapping, or table, optional
        What is regressed out of the frequencies: a number for each recording and condition.
    false_alarms : float
        Probability that an unchanged recording has an index above 1.

    Returns
    -------
    DataFrame
        The columns of ``damage_index.csv``, a row for each recording.

    Raises
    ------
    InputError
        For a reference that names no recording, and conditions that one does not have.
    """
    given: Any = {} if conditions is None else conditions
    given = given.to_dict("index") if hasattr(given, "to_dict") else given
    known = {name: given.get(name, {}) for name in recordings}
    for key, value, is_right, remedy in (
        ("reference", reference, isinstance(reference, str) or reference >= 1, "1 or more"),
        ("false_alarms", false_alarms, 0.0 < false_alarms < 0.5, "a probability below 0.5"),
    ):
        if not is_right:
            raise InputError("damage_index", f"{value} cannot be", f"give {remedy}", key)
    every = list(dict.fromkeys(name for values in given.values() for name in values))
    asked = None, every, reference, false_alarms
    entries = {name: result.summary for name, result in recordings.items()}
    return Compared(entries, following_of(known, *asked, "damage_index")).damage


def damage_table(
    followed: Sequence[FollowedMode], names: Collection[str], following: Following
) -> pd.DataFrame:
    """A row for each recording, in the order of each structure.

    ``damage_index`` is the distance from the reference in units of its limit, which an unchanged
    recording exceeds with the probability ``following.false_alarms``.
    """
    import pandas as pd

    places = following.order.places if following.order else {}
    rows = []
    for group, ordered in grouped(names, places).items():
        modes = [mode for mode in followed if mode.group == group]
        frequencies = _frequencies(modes, ordered, following)
        for number, name in enumerate(ordered):
            distance = frequencies.distance(number, following.false_alarms)
            place, is_reference = places.get(name, number + 1.0), frequencies.is_reference[number]
            cells = _cells(distance, frequencies, number)
            rows.append((group, name, place, bool(is_reference), *cells))
    return pd.DataFrame(rows, columns=list(_TYPES)).astype(_TYPES)


def _frequencies(
    modes: Sequence[FollowedMode], names: Sequence[str], following: Following
) -> Frequencies:
    values = np.full((2, len(names), len(modes)), np.nan)
    for column, mode in enumerate(modes):
        rows = [names.index(name) for name in mode.recordings]
        values[0, rows, column] = [estimate.frequency_hz for estimate in mode.modes]
        values[1, rows, column] = [estimate.frequency_se_hz for estimate in mode.modes]
    reference = following.reference
    chosen = names[:reference] if isinstance(reference, int) else (reference or ())
    conditions = [[of[name] for of in following.corrected.values()] for name in names]
    return Frequencies(values[0], values[1], np.array(conditions), np.isin(names, chosen))


def _cells(distance: Distance, frequencies: Frequencies, number: int) -> Iterator[object]:
    """What stands in the row of a recording."""
    judged = not distance.reason
    yield from (distance.index, distance.p_value, distance.index > 1.0 if judged else None)
    yield " ".join(str(mode + 1) for mode in distance.modes) or None
    missing = " ".join(str(mode + 1) for mode in frequencies.missing(number)) or None
    if judged:
        standardised = np.abs(np.array(distance.left) / np.array(distance.standard_errors))
        farthest = int(np.argmax(standardised))
        mode = distance.modes[farthest]
        expected = frequencies.values[number, mode] - distance.left[farthest]
        yield from (mode + 1, 100.0 * distance.left[farthest] / expected, None, missing)
    else:
        yield from (None, math.nan, _REASONS[distance.reason], missing)
