"""What a part of the page is made of, and how its figures are set."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from evopem.figures import REPORT_FIGURES
from evopem.figures.chart import Chart, ReportFigure
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
    caption: str
    paragraphs: Sequence[str]
    data: Sequence[str]  # files that hold the data of the figure
    download: Download  # the data of the figure as CSV
    svg: Markup | None  # None where the figure was not drawn
    panels: str  # what the page draws for a reader to zoom, as JSON; empty where it does not
    columns: int  # panels of a row

    @classmethod
    def of(
        cls, chart: Chart, svg: str | None, words: tuple[str, str, str], most_cells: int, **own: Any
    ) -> DrawnFigure:
        """A chart by its id, title and caption, with its data as a file of at most so many cells.

        `own`: name of the data set, paragraphs, and the files that hold the data.
        """
        name, title, caption = words
        panels = chart.page_form() if svg else []
        return cls(
            *(name, title, caption, own.get("paragraphs", ()), own["data"]),
            download=csv_download(chart.table, own["dataset"], name, most_cells),
            svg=None if svg is None else inline_svg(svg, name, caption),
            panels=json.dumps(panels, ensure_ascii=False) if panels else "",
            columns=chart.columns,
        )

    @property
    def for_experts(self) -> bool:
        """Whether the paragraphs wait to be opened."""
        return self.id not in FOR_ALL


def drawn_figure(figure: ReportFigure, view: View, svg: str | None) -> DrawnFigure:
    """A figure of the report with its sentences, its data and its panels."""
    return DrawnFigure.of(
        figure.chart(view),
        svg,
        (figure.name, figure.title_of(view), figure.caption_of(view)),
        MOST_CELLS // (2 - view.is_single),
        dataset=view.name,
        data=figure.data,
        paragraphs=sentences_of(figure.name, view),
    )
