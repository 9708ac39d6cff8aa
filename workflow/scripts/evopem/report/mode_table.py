"""The estimated modes beside those of the truth and of the chapter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from evopem.models.mode_matching import damping_deviation, frequency_deviation, match_modes
from evopem.models.modes import Mode


@dataclass(frozen=True)
class ModeRow:
    """One row of the table of modes; None where there is no corresponding mode."""

    estimate: Mode | None
    truth: Mode | None
    chapter: Mode | None

    @property
    def frequency_deviation(self) -> float:
        """Estimate minus truth of the frequency in standard errors; NaN where not known."""
        if self.estimate is None or self.truth is None:
            return math.nan
        return frequency_deviation(self.estimate, self.truth)

    @property
    def damping_deviation(self) -> float:
        """Estimate minus truth of the damping in standard errors; NaN where not known."""
        if self.estimate is None or self.truth is None:
            return math.nan
        return damping_deviation(self.estimate, self.truth)


def mode_rows(
    estimates: Sequence[Mode], truth: Sequence[Mode], chapter: Sequence[Mode]
) -> list[ModeRow]:
    """Rows by frequency: every estimated mode, and the true and chapter modes without one."""
    to_truth, to_chapter = match_modes(estimates, truth), match_modes(estimates, chapter)
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
    beside = match_modes(missed_truth, missed_chapter)
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
    return mode.frequency_hz if mode else math.inf
