"""The figures of the report, in its order, drawn by matplotlib as SVG from the results."""

from collections.abc import Callable
from functools import wraps
from importlib import import_module

from evopem.figures.chart import Chart, nothing
from evopem.figures.draw import draw
from evopem.figures.style import svg_text
from evopem.results.dataset import DatasetResults
from evopem.results.layout import FIGURES


def _applied(name: str) -> Callable[[DatasetResults], Chart]:
    figure = FIGURES[name]
    drawn: Callable[[DatasetResults], Chart]
    drawn = getattr(import_module(f"{__name__}.{figure.module}"), name)

    @wraps(drawn)
    def chart_of(results: DatasetResults) -> Chart:
        without = figure.in_time and results.of_responses
        return nothing("Frequency responses are no samples in time.") if without else drawn(results)

    return chart_of


CHARTS = {name: _applied(name) for name in FIGURES}
"""What each figure shows; the page leaves out one with nothing to draw."""


def svg_texts(results: DatasetResults) -> dict[str, str]:
    """Every figure of one data set as SVG by name, with a sentence where one does not apply."""
    return {name: svg_text(draw(chart_of(results))) for name, chart_of in CHARTS.items()}
