"""What a part of the page is made of, and how its figures are set."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from evopem.figures.registry import REPORT_FIGURES
from evopem.figures.report_figure import ReportFigure
from evopem.figures.view import View
from evopem.report.downloads import MOST_CELLS, Download, csv_download
from evopem.report.inline_svg import inline_svg
from evopem.report.sentences.about_figures import sentences_of

# Figures whose sentences do not wait to be opened.
FOR_ALL = frozenset({"stabilization"})


@dataclass(frozen=True, eq=False)
class Material:
    """All that a page is made of."""

    view: View
    figures: Mapping[str, str]  # SVG texts by the names of the figures
    wall_clock: Mapping[str, float]  # seconds by stage
    config_text: str  # the complete configuration of the data set
    commit: str  # of the workflow that writes the report

    def figures_of(self, part: str) -> dict[str, DrawnFigure]:
        """The figures of a part of the page, by name."""
        return {
            figure.name: drawn_figure(figure, self.view, self.figures.get(figure.name))
            for figure in REPORT_FIGURES
            if figure.part == part and figure.applies(self.view)
        }


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    id: str
    title: Callable[[View], str]  # its heading
    content: Callable[[Material], dict[str, Any]] | None = None  # None for figures alone
    applies: Callable[[View], bool] = lambda _: True  # whether the page has it

    def of(self, material: Material) -> dict[str, Any]:
        """What the page shows: heading, template and content."""
        content = self.content or (lambda given: {"figures": given.figures_of(self.id)})
        return {
            "id": self.id,
            "title": self.title(material.view),
            "template": f"section_{self.id if self.content else 'figures'}.html.j2",
            "content": content(material),
        }


@dataclass(frozen=True)
class DrawnFigure:
    """A figure in the page."""

    id: str
    title: str
    paragraphs: list[str]
    caption: str
    data: list[str]  # files that hold the data of the figure
    download: Download  # the data of the figure as CSV
    svg: Markup | None  # none where the figure was not drawn
    panels: str  # what the page draws for a reader to zoom, as JSON; empty where it does not
    columns: int  # panels of a row
    for_experts: bool  # whether the paragraphs wait to be opened


def drawn_figure(figure: ReportFigure, view: View, svg: str | None) -> DrawnFigure:
    """A figure with its sentences, its data and its panels."""
    caption, chart = figure.caption_of(view), figure.chart(view)
    panels = chart.page_form() if svg else []
    return DrawnFigure(
        id=figure.name,
        title=figure.title_of(view),
        paragraphs=sentences_of(figure.name, view),
        caption=caption,
        data=list(figure.data),
        download=csv_download(
            chart.table, view.name, figure.name, MOST_CELLS // (2 - view.is_single)
        ),
        svg=None if svg is None else inline_svg(svg, figure.name, caption),
        panels=json.dumps(panels, ensure_ascii=False) if panels else "",
        columns=chart.columns,
        for_experts=figure.name not in FOR_ALL,
    )
