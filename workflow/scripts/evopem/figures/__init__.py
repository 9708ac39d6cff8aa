"""The figures of the report, in its order, drawn by matplotlib as SVG from the results."""

from __future__ import annotations

from pathlib import Path

from evopem.figures import frequency_domain, orders, time_domain
from evopem.figures.chart import ReportFigure, nothing
from evopem.figures.draw import draw
from evopem.figures.style import save_svg, svg_text
from evopem.figures.view import Results, View, view_of
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


def svg_texts(results: Results | View) -> dict[str, str]:
    """Every figure that applies to the results of one data set as SVG, by name."""
    view = view_of(results)
    return {
        figure.name: svg_text(draw(figure.chart(view)))
        for figure in REPORT_FIGURES
        if figure.applies(view)
    }


def draw_all(results: Results | View, directory: Path) -> list[Path]:
    """Draw every figure of one data set, with a sentence where one does not apply."""
    view, files = view_of(results), []
    for figure in REPORT_FIGURES:
        chart = (
            figure.chart(view)
            if figure.applies(view)
            else nothing("This figure does not apply to the model.")
        )
        file = directory / f"{figure.name}.svg"
        save_svg(draw(chart), file)
        files.append(file)
    return files
