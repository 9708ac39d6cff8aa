"""The sentences that stand with each figure."""

from __future__ import annotations

from collections.abc import Callable

from evopem.figures.view import PolynomialView, View
from evopem.report.sentences.about_model import frequency_response, poles
from evopem.report.sentences.about_orders import delay, phases, stabilization
from evopem.report.sentences.about_recording import recording
from evopem.report.sentences.about_search import search
from evopem.report.sentences.about_spectrum import spectrum
from evopem.report.sentences.about_validation import horizons, residuals, simulation
from evopem.results.dataset import DatasetResults

OF_POLYNOMIALS: dict[str, Callable[[DatasetResults], list[str]]] = {
    "poles_zeros": poles,
    "frequency_response": frequency_response,
    "simulation": simulation,
    "horizons": horizons,
    "residuals": residuals,
    "record": recording,
    "spectrum": spectrum,
    "delay": delay,
    "phases": phases,
    "convergence": search,
}


def sentences_of(figure: str, view: View) -> list[str]:
    """The paragraphs about a figure; none where the figure and its caption say all."""
    if figure == "stabilization":
        return stabilization(view)
    if isinstance(view, PolynomialView) and figure in OF_POLYNOMIALS:
        return OF_POLYNOMIALS[figure](view.results)
    return []
