"""The figures of the report, in its order, drawn by matplotlib as SVG from the results."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from evopem.figures.chart import Chart
from evopem.figures.draw import draw
from evopem.figures.frequency_domain import (
    frequency_response,
    gain,
    nyquist,
    residual_spectrum,
    spectrum,
)
from evopem.figures.orders import convergence, delay, phases, poles_zeros, stabilization
from evopem.figures.style import svg_text
from evopem.figures.time_domain import (
    horizons,
    measured_and_simulated,
    record,
    residuals,
    simulation,
    simulation_as_recorded,
    step_and_impulse,
)
from evopem.figures.view import View, view_of
from evopem.results.dataset import DatasetResults

RESPONSES = ("frequency_response.csv", "spectrum.csv")
CORRELATIONS = ("residual_autocorrelation.csv", "cross_correlation.csv")


class ReportFigure(NamedTuple):
    """One figure of the report; ``captions.html.j2`` has its title and caption."""

    part: str  # the part of the page that it stands in
    chart: Callable[[View], Chart]  # of a view; the page leaves out one with nothing to draw
    data: tuple[str, ...]  # names of the files of the results that hold what is drawn


REPORT_FIGURES = {
    "measured_and_simulated": ReportFigure("summary", measured_and_simulated, ("simulation.csv",)),
    "gain": ReportFigure("summary", gain, RESPONSES),
    "poles_zeros": ReportFigure("modes", poles_zeros, ("model.json",)),
    "stabilization": ReportFigure("modes", stabilization, ("validation.json",)),
    "frequency_response": ReportFigure("response", frequency_response, RESPONSES),
    "step_and_impulse": ReportFigure("response", step_and_impulse, ("time_response.csv",)),
    "nyquist": ReportFigure("response", nyquist, RESPONSES),
    "simulation": ReportFigure("errors", simulation, ("simulation.csv",)),
    "simulation_as_recorded": ReportFigure("errors", simulation_as_recorded, ("simulation.csv",)),
    "horizons": ReportFigure("errors", horizons, ("horizons.csv",)),
    "residuals": ReportFigure("residual_tests", residuals, CORRELATIONS),
    "residual_spectrum": ReportFigure("residual_tests", residual_spectrum, ("simulation.csv",)),
    "record": ReportFigure("recording", record, ("recording.npz", "prepared.npz")),
    "spectrum": ReportFigure("recording", spectrum, ("spectrum.csv",)),
    "delay": ReportFigure("selection", delay, ("candidates.csv",)),
    "phases": ReportFigure("selection", phases, ("candidates.csv",)),
    "convergence": ReportFigure("selection", convergence, ("model.json",)),
}
"""By their names, in the order of :data:`evopem.results.layout.FIGURES`."""


def svg_texts(results: DatasetResults | View) -> dict[str, str]:
    """Every figure of one data set as SVG by name, with a sentence where one does not apply."""
    view = view_of(results)
    return {name: svg_text(draw(each.chart(view))) for name, each in REPORT_FIGURES.items()}
