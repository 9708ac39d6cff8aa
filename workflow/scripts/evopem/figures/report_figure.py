"""A figure of the report: what it is called, where it stands, when it applies, and its chart."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from evopem.figures.chart import Chart
from evopem.figures.view import View

# Panels of a figure at most; the table has all pairs of channels.
MOST_PANELS = 60


@dataclass(frozen=True)
class ReportFigure:
    """One figure of the report."""

    name: str  # one of :data:`evopem.results.layout.FIGURES`
    part: str  # the part of the page that it stands in
    title: str  # what is drawn
    caption: str
    data: tuple[str, ...]  # names of the files of the results that hold what is drawn
    chart: Callable[[View], Chart]  # the chart of a view
    applies: Callable[[View], bool] = lambda _: True  # whether the page shows it
    # Title and caption for a model without input; empty where they are the same.
    without_input: tuple[str, str] = ("", "")

    def title_of(self, view: View) -> str:
        """What the figure of these results is called."""
        return self.title if view.has_input else self.without_input[0] or self.title

    def caption_of(self, view: View) -> str:
        """What is drawn of these results."""
        return self.caption if view.has_input else self.without_input[1] or self.caption


def columns_of(view: View, panels: int) -> int:
    """Panels of a row: one for each input, else as many as leave them room."""
    if 2 <= len(view.inputs) <= 4 and panels % len(view.inputs) == 0:
        return len(view.inputs)
    return 1 if panels == 1 else 2 if panels <= 4 else min(3, math.ceil(panels / 2))


def small(panels: Sequence[object], height: int) -> int:
    """The height of a panel, less where there are many."""
    return height if len(panels) <= 2 else max(120, round(height * 0.65))
