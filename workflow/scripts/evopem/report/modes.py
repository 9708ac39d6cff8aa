"""The modes on the page: beside those of the truth and of the chapter, and their shapes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from evopem.figures.shapes import ShapeDrawing
from evopem.figures.view import View
from evopem.models.mode_matching import damping_deviation, frequency_deviation, match_modes
from evopem.models.modes import Mode
from evopem.report import chapter
from evopem.report.numbers import hertz
from evopem.report.verdict import mode_lines


@dataclass(frozen=True)
class ModeRow:
    """One row of the table of modes; None where there is no corresponding mode."""

    estimate: Mode | None
    truth: Mode | None
    chapter: Mode | None

    @property
    def deviations(self) -> tuple[float, float]:
        """Estimate minus truth of frequency and damping in standard errors; NaN where not known."""
        if self.estimate is None or self.truth is None:
            return math.nan, math.nan
        both = self.estimate, self.truth
        return frequency_deviation(*both), damping_deviation(*both)


def mode_rows(
    estimates: Sequence[Mode], truth: Sequence[Mode], of_chapter: Sequence[Mode]
) -> list[ModeRow]:
    """Rows by frequency: every estimated mode, and the true and chapter modes without one."""
    to_truth, to_chapter = match_modes(estimates, truth), match_modes(estimates, of_chapter)
    missed_truth = [mode for j, mode in enumerate(truth) if j not in to_truth.values()]
    missed = [mode for j, mode in enumerate(of_chapter) if j not in to_chapter.values()]
    beside = match_modes(missed_truth, missed)
    rows = [
        *(
            (
                mode,
                truth[to_truth[i]] if i in to_truth else None,
                of_chapter[to_chapter[i]] if i in to_chapter else None,
            )
            for i, mode in enumerate(estimates)
        ),
        *(
            (None, mode, missed[beside[j]] if j in beside else None)
            for j, mode in enumerate(missed_truth)
        ),
        *((None, None, mode) for j, mode in enumerate(missed) if j not in beside.values()),
    ]
    return [
        ModeRow(*row) for row in sorted(rows, key=lambda row: next(filter(None, row)).frequency_hz)
    ]


def content(view: View) -> dict[str, Any]:
    """The table of modes, their lines of evidence, and the shapes of several outputs."""
    stand_in = chapter.stands_in_for_the_chapter(view.results.settings)
    true_modes = view.truth.modes if view.truth else ()
    geometry, names = view.results.settings.geometry, tuple(each.name for each in view.outputs)
    drawing = ShapeDrawing(geometry, names) if geometry is not None else None
    labels = [f"Shape of mode {k} at {hertz(m.frequency_hz)}" for k, m in enumerate(view.modes, 1)]
    return {
        "rows": mode_rows(view.modes, true_modes, chapter.MODES if stand_in else ()),
        "lines": {line.mode.pole: line for line in mode_lines(view)},
        "labels": labels if len(names) > 1 else [],
        "drawn": [
            (
                Markup(drawing.still(mode.shape, label)),
                Markup(drawing.moving(mode.shape, f"{label}, moving")),
            )
            for mode, label in zip(view.modes, labels, strict=True)
            if drawing and len(names) > 1
        ],
        "assurance": view.results.validation.modes.assurance,
        "has_truth": bool(true_modes),
        "chapter_orders": chapter.ORDERS if stand_in else None,
    }
