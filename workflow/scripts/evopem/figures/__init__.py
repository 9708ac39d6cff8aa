"""The figures of the report, in its order, drawn by matplotlib as SVG from the results."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import NamedTuple

from evopem.figures import frequency_domain, orders, time_domain
from evopem.figures.chart import Chart
from evopem.figures.draw import draw
from evopem.figures.style import svg_text
from evopem.results.dataset import DatasetResults

RESPONSES = ("frequency_response.csv", "spectrum.csv")
CORRELATIONS = ("residual_autocorrelation.csv", "cross_correlation.csv")


class ReportFigure(NamedTuple):
    """One figure of the report; ``captions.html.j2`` has its title and caption."""

    part: str  # the part of the page that it stands in
    chart: Callable[[DatasetResults], Chart]  # the page leaves out one with nothing to draw
    data: tuple[str, ...]  # names of the files of the results that hold what is drawn


# The part, the module with a function of the figure's name, and the files.
_FIGURES: dict[str, tuple[str, ModuleType, tuple[str, ...]]] = {
    "measured_and_simulated": ("summary", time_domain, ("simulation.csv",)),
    "gain": ("summary", frequency_domain, RESPONSES),
    "poles_zeros": ("modes", orders, ("model.json",)),
    "stabilization": ("modes", orders, ("validation.json",)),
    "frequency_response": ("response", frequency_domain, RESPONSES),
    "step_and_impulse": ("response", time_domain, ("time_response.csv",)),
    "nyquist": ("response", frequency_domain, RESPONSES),
    "simulation": ("errors", time_domain, ("simulation.csv",)),
    "simulation_as_recorded": ("errors", time_domain, ("simulation.csv",)),
    "horizons": ("errors", time_domain, ("horizons.csv",)),
    "residuals": ("residual_tests", time_domain, CORRELATIONS),
    "residual_spectrum": ("residual_tests", frequency_domain, ("simulation.csv",)),
    "record": ("recording", time_domain, ("recording.npz", "prepared.npz")),
    "spectrum": ("recording", frequency_domain, ("spectrum.csv",)),
    "delay": ("selection", orders, ("candidates.csv",)),
    "phases": ("selection", orders, ("candidates.csv",)),
    "convergence": ("selection", orders, ("model.json",)),
}
REPORT_FIGURES = {
    name: ReportFigure(part, getattr(module, name), data)
    for name, (part, module, data) in _FIGURES.items()
}
"""By their names, in the order of :data:`evopem.results.layout.FIGURES`."""


def svg_texts(results: DatasetResults) -> dict[str, str]:
    """Every figure of one data set as SVG by name, with a sentence where one does not apply."""
    return {name: svg_text(draw(each.chart(results))) for name, each in REPORT_FIGURES.items()}
