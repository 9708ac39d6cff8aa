"""The figures of the report, in its order, drawn by matplotlib as SVG from the results."""

from collections.abc import Callable
from importlib import import_module

from evopem.figures.chart import Chart
from evopem.figures.draw import draw
from evopem.figures.style import svg_text
from evopem.results.dataset import DatasetResults
from evopem.results.layout import FIGURES

CHARTS: dict[str, Callable[[DatasetResults], Chart]] = {
    name: getattr(import_module(f"{__name__}.{figure.module}"), name)
    for name, figure in FIGURES.items()
}
"""What each figure shows; the page leaves out one with nothing to draw."""


def svg_texts(results: DatasetResults) -> dict[str, str]:
    """Every figure of one data set as SVG by name, with a sentence where one does not apply."""
    return {name: svg_text(draw(chart_of(results))) for name, chart_of in CHARTS.items()}
