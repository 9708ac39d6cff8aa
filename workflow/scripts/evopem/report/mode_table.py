"""The modes, each set beside the truth and the chapter's numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

# Table 2 of the chapter: frequency in Hz, damping in percent.
CHAPTER = (
    {"frequency_hz": 5.36, "damping_percent": 0.91},
    {"frequency_hz": 16.65, "damping_percent": 17.50},
    {"frequency_hz": 37.00, "damping_percent": 1.07},
)
CHAPTER_ORDERS = {"na": 7, "nb": 6, "nc": 7, "nk": 3}
# Modes whose frequencies differ by more than this share are not the same mode.
SAME_MODE = 0.15

Mode = Mapping[str, Any]


@dataclass(frozen=True)
class ModeRow:
    """One line of the table of modes; what has no counterpart is None."""

    estimate: Mode | None
    truth: Mode | None
    chapter: Mode | None

    @property
    def frequency_deviation(self) -> float | None:
        """Estimate minus truth in standard errors of the estimate, for the frequency."""
        return self._deviation("frequency_hz", "frequency_se_hz")

    @property
    def damping_deviation(self) -> float | None:
        """Estimate minus truth in standard errors of the estimate, for the damping."""
        return self._deviation("damping_percent", "damping_se_percent")

    def _deviation(self, value: str, error: str) -> float | None:
        if self.estimate is None or self.truth is None or not self.estimate.get(error):
            return None
        return (float(self.estimate[value]) - float(self.truth[value])) / float(
            self.estimate[error]
        )


def match(estimates: Sequence[Mode], others: Sequence[Mode]) -> dict[int, int]:
    """Pair modes by frequency, each at most once, with the least sum of log distances.

    Returns
    -------
    dict of int to int
        Index of the other for indices of the estimates; pairs more than 15 % apart are left out.
    """
    from scipy.optimize import linear_sum_assignment

    if not estimates or not others:
        return {}
    distance = np.abs(
        np.subtract.outer(
            [math.log(float(mode["frequency_hz"])) for mode in estimates],
            [math.log(float(mode["frequency_hz"])) for mode in others],
        )
    )
    # A pair too far apart costs the same however far, so that it never displaces a good one.
    limit = math.log(1 + SAME_MODE)
    rows, columns = linear_sum_assignment(np.where(distance <= limit, distance, 1e3))
    return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if distance[r, c] <= limit}


def mode_rows(
    estimates: Sequence[Mode], truth: Sequence[Mode], chapter: Sequence[Mode]
) -> list[ModeRow]:
    """Rows by frequency: every estimated mode, and the true and chapter modes without one."""
    to_truth, to_chapter = match(estimates, truth), match(estimates, chapter)
    rows = [
        ModeRow(
            mode,
            truth[to_truth[i]] if i in to_truth else None,
            chapter[to_chapter[i]] if i in to_chapter else None,
        )
        for i, mode in enumerate(estimates)
    ]
    missed_truth = [mode for j, mode in enumerate(truth) if j not in to_truth.values()]
    missed_chapter = [mode for j, mode in enumerate(chapter) if j not in to_chapter.values()]
    beside = match(missed_truth, missed_chapter)
    rows += [
        ModeRow(None, mode, missed_chapter[beside[j]] if j in beside else None)
        for j, mode in enumerate(missed_truth)
    ]
    rows += [
        ModeRow(None, None, mode)
        for j, mode in enumerate(missed_chapter)
        if j not in beside.values()
    ]
    return sorted(rows, key=_frequency)


def _frequency(row: ModeRow) -> float:
    mode = row.estimate or row.truth or row.chapter
    return float(mode["frequency_hz"]) if mode else math.inf
