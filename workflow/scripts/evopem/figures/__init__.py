"""The figures of the report, in its order, drawn by matplotlib as SVG from the results."""

from __future__ import annotations

from evopem.figures import frequency_domain, orders, time_domain
from evopem.figures.chart import ReportFigure
from evopem.figures.draw import draw
from evopem.figures.style import svg_text
from evopem.figures.view import View, view_of
from evopem.results.dataset import DatasetResults
from evopem.results.layout import FIGURES

_BY_NAME = {
    figure.name: figure
    for module in (time_domain, frequency_domain, orders)
    for figure in module.FIGURES
}
REPORT_FIGURES: tuple[ReportFigure, ...] = tuple(_BY_NAME[name] for name in FIGURES)
"""The figures in the order of :data:`evopem.results.layout.FIGURES`."""


def figure_of(name: str) -> ReportFigure:
    """The figure of that name."""
    return _BY_NAME[name]


def svg_texts(results: DatasetResults | View) -> dict[str, str]:
    """Every figure of one data set as SVG by name, with a sentence where one does not apply."""
    view = view_of(results)
    return {figure.name: svg_text(draw(figure.chart(view))) for figure in REPORT_FIGURES}
