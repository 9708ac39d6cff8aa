"""What a part of the page is made of, and how its figures are set."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from evopem.figures.registry import REPORT_FIGURES
from evopem.figures.report_figure import ReportFigure
from evopem.figures.view import PolynomialView, View
from evopem.report.downloads import MOST_CELLS, Download, csv_download
from evopem.report.inline_svg import inline_svg
from evopem.report.sentences.about_figures import sentences_of

# Figures whose sentences do not wait to be opened.
FOR_ALL = frozenset({"stabilization"})


@dataclass(frozen=True, eq=False)
class Material:
    """All that a page is made of.

    Attributes
    ----------
    view : View
    figures : mapping of str to str
        SVG texts by the names of the figures.
    wall_clock : mapping of str to float
        Seconds by stage.
    config_text : str
        The complete configuration of the data set.
    commit : str
        Of the workflow that writes the report.
    """

    view: View
    figures: Mapping[str, str]
    wall_clock: Mapping[str, float]
    config_text: str
    commit: str

    def figures_of(self, part: str) -> dict[str, DrawnFigure]:
        """The figures of a part of the page, by name."""
        return {
            figure.name: drawn_figure(figure, self.view, self.figures.get(figure.name))
            for figure in REPORT_FIGURES
            if figure.part == part and figure.applies(self.view)
        }


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes
    ----------
    id : str
    title : callable
        Its heading, of a view.
    content : callable
        What its template shows, of the material.
    applies : callable
        Whether the page has it.
    """

    id: str
    title: Callable[[View], str]
    content: Callable[[Material], dict[str, Any]]
    applies: Callable[[View], bool] = lambda _: True

    @property
    def template(self) -> str:
        """Name of its template."""
        return f"section_{self.id}.html.j2"


@dataclass(frozen=True)
class DrawnFigure:
    """A figure in the page.

    Attributes
    ----------
    id, title : str
    paragraphs : list of str
    caption : str
    data : list of str
        Files that hold the data of the figure.
    download : Download
        The data of the figure as CSV.
    svg : Markup, optional
        None where the figure was not drawn.
    panels : str
        What the page draws for a reader to zoom, as JSON; empty where it does not.
    columns : int
        Panels of a row.
    for_experts : bool
        Whether the paragraphs wait to be opened.
    """

    id: str
    title: str
    paragraphs: list[str]
    caption: str
    data: list[str]
    download: Download
    svg: Markup | None
    panels: str
    columns: int
    for_experts: bool


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


def is_polynomial(view: View) -> bool:
    """Whether the results are of a polynomial model with one output and at most one input."""
    return isinstance(view, PolynomialView)
