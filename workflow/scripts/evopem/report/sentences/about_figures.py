"""The sentences that stand with each figure."""

from __future__ import annotations

import re
from collections.abc import Callable

from evopem.config.structures import plant_order, structure_name, varied_order
from evopem.estimation.search.problem import SearchDiagnostics
from evopem.figures.orders import tied_text
from evopem.figures.view import View
from evopem.models.mode_matching import PERSISTENT_ORDERS, persistent_frequencies
from evopem.report.numbers import (
    THIN,
    count,
    enumeration,
    hertz,
    is_number,
    number,
    percent,
    plural,
)
from evopem.report.sentences.about_model import frequency_response, poles
from evopem.report.sentences.about_recording import recording
from evopem.report.sentences.about_validation import horizons, residuals, simulation
from evopem.results.dataset import DatasetResults
from evopem.signals.spectral.peaks import line_spacing

# The search counts as near its final objective from this ratio on.
NEAR = 1.001


def search(view: View) -> list[str]:
    """Evaluations of all searches, and the diagnostics of the search for the selected model."""
    record = view.results.model
    found, candidates = record.search.diagnostics, view.candidates
    sentences = []
    if candidates is not None:
        sentences.append(
            f"The search of {plural(len(candidates), 'candidate')} took"
            f" {count(int(candidates['evaluations'].sum()))} evaluations of the objective;"
            f" {count(int((candidates['n_confirming'] > 0).sum()))} of them were confirmed by"
            " another restart. The objective of the others may lie above its minimum."
        )
    if found.generations or found.n_multistart:
        sentences += [*_convergence(found), _restarts(found), _multistart(found)]
    else:
        sentences.append(
            f"The model was fitted by descents from {plural(found.n_restarts, 'point')};"
            f" {found.n_confirming} beside the best ended at the same optimum."
        )
    sentences.append(
        "The descents that converged ended at"
        f" {plural(found.n_local_optima, 'local optimum', 'distinct local optima')}."
        f" Its objective (“{record.search.settings.objective}”) is {percent(record.objective, 4)}."
    )
    if record.initial_states.size:
        sentences.append(
            "The state before the first residual"
            f" ({plural(record.initial_states.size, 'value')}) was estimated with the coefficients,"
            " so no initial transient adds to the residuals."
        )
    return [" ".join(sentences)]


def _convergence(found: SearchDiagnostics) -> list[str]:
    history = found.convergence
    if not history or history[-1][1] <= 0:
        return []
    spent, final = history[-1]
    near = next(evaluations for evaluations, value in history if value <= NEAR * final)
    return [
        "The search of the selected model was within 0.1 % of its final objective after"
        f" {count(near)} of {count(spent)} evaluations."
    ]


def _restarts(found: SearchDiagnostics) -> str:
    others = found.n_restarts - 1
    if others < 1:
        return "The search had a single restart, so no other restart confirms the optimum."
    return (
        f"The search had {found.n_restarts} independent restarts;"
        f" {found.n_confirming} of the {others} beside the best ended at the same optimum."
    )


def _multistart(found: SearchDiagnostics) -> str:
    if found.n_multistart == 0 or not is_number(found.undiscovered_probability):
        return "There were no descents from random points alone."
    return (
        f"There were batches of descents from {count(found.n_multistart)} random points: the"
        " estimated probability that a further descent leads to an undiscovered local optimum is"
        f" {number(100.0 * found.undiscovered_probability, 2)} %."
    )


NAMES = {
    "nc": "Order of C, nc",
    "nd": "Order of D, nd",
    "na": "Order of A, na",
    "nb": "Number of B coefficients, nb",
}


def delay(results: DatasetResults) -> list[str]:
    """The selected delay, and how much BIC varies over the orders."""
    order = plant_order(results.model.structure)
    selected = results.phases["delay"].orders.single.nk
    tried = results.candidates[results.candidates["phase"] == "delay"]
    sentences = [_reason(results, "delay")]
    spread = tried.groupby("nk")["bic"].agg(lambda bic: bic.max() - bic.min())
    if len(spread) > 1:
        others = spread.drop(selected)
        low, high = number(others.min(), 2), number(others.max(), 2)
        sentences.append(
            f"Over the orders {tried[order].min()} to {tried[order].max()} the BIC of nk ="
            f" {selected} varies by {number(spread[selected], 2)}, that of the other delays by"
            f" {low if low == high else f'{low} to {high}'}. A small variation speaks for a"
            " delay."
        )
    if results.truth is not None:
        true, found = results.truth.delay_samples, results.model.polynomials.orders.single.nk
        difference = "which was found" if true == found else f"{abs(true - found)} off"
        sentences.append(f"The true delay is {plural(true, 'sample')}, {difference}.")
    return [" ".join(sentences)]


def phases(results: DatasetResults) -> list[str]:
    """The selection of each phase of the orders, beside the smallest RSS."""
    paragraphs = []
    structure = results.model.structure
    if results.decisions is not None:
        names = dict.fromkeys(
            structure_name(each.orders.structure)
            for each in results.phases["structures"].candidates
        )
        return [
            f"{enumeration(list(names))} models of growing order were tried until nothing was"
            f" gained. {_reason(results, 'structures')} {_reason(results, 'chosen')}",
            "RSS and BIC are those of one-step errors on the same estimation samples; between"
            " structures the errors on held-out samples decide, which the decisions list.",
        ]
    for phase in results.phases:
        if phase == "delay":
            continue
        order = varied_order(phase, structure)
        name = NAMES.get(phase) or f"Plant order {tied_text(structure)}"
        candidates = results.phases[phase].candidates
        own = results.phases[phase].selected
        least = min(candidates, key=lambda candidate: candidate.criteria.rss)
        tried = [getattr(candidate.orders.single, order) for candidate in candidates]
        value, smallest = getattr(own.orders.single, order), getattr(least.orders.single, order)
        text = (
            f"{name}, searched from {min(tried)} to {max(tried)}: {value} is selected, with an"
            f" RSS of {percent(own.criteria.rss, 4)}"
        )
        if smallest != value:
            text += f"; the smallest RSS, {percent(least.criteria.rss, 4)}, is at {smallest}"
        paragraphs.append(f"{text}. {_reason(results, phase)}")
    paragraphs.append(
        "BIC decides. RSS is shown for comparison: it does not penalise the number of coefficients."
    )
    return paragraphs


def stabilization(view: View) -> list[str]:
    """The natural frequencies that persist over the orders."""
    poles = view.poles_of_orders
    if not poles:
        return ["No candidate has an oscillating mode."]
    persistent = persistent_frequencies(poles)
    lead = f"Over the orders {poles[0].order} to {poles[-1].order},"
    if not persistent:
        return [f"{lead} no pole is stable over {PERSISTENT_ORDERS} successive orders."]
    return [
        f"{lead} poles at {enumeration([hertz(frequency) for frequency in persistent])} are stable,"
        f" within 1{THIN}% in frequency and 10{THIN}% in damping, over {PERSISTENT_ORDERS}"
        " orders or more."
    ]


def _reason(results: DatasetResults, phase: str) -> str:
    """Why a candidate was selected, with true minus signs."""
    return re.sub(r"(?<![\w-])-(?=\d)", "−", results.phases[phase].reason)


def spectrum(results: DatasetResults) -> list[str]:
    """Peaks of the spectrum, and the order of A that they require."""
    summary = results.spectrum_summary
    segments = f", averaged over {count(summary.segments)} segments" if summary.segments > 1 else ""
    estimate = (
        "Thomson's multitaper estimate with time-halfbandwidth product"
        f" {number(summary.time_halfbandwidth)} ({summary.tapers} tapers) and transforms of"
        f" {count(summary.nfft)} points{segments} has a resolution of"
        f" {hertz(summary.resolution_hz)}."
    )
    frequencies = [peak.frequency_hz for peak in summary.peaks]
    if not frequencies:
        return [f"{estimate} It has no significant peak."]
    spacing = line_spacing(frequencies)
    if spacing is not None:
        return [
            f"{estimate} Its {count(len(frequencies))} significant peaks are about {hertz(spacing)}"
            " apart. They are the lines of a periodic input and do not indicate the number of"
            " modes."
        ]
    places = enumeration([hertz(frequency) for frequency in frequencies])
    heights = enumeration([f"{number(peak.prominence_db, 2)}{THIN}dB" for peak in summary.peaks])
    one = len(frequencies) == 1
    return [
        f"{estimate} It has {plural(len(frequencies), 'significant peak')}, at {places}, with"
        f" {'a prominence' if one else 'prominences'} of {heights}."
        f" {'It' if one else 'Each'} requires a pair of complex poles, so the order na is at least"
        f" {2 * len(frequencies)}."
    ]


OF_EVERY_MODEL: dict[str, Callable[[View], list[str]]] = {
    "poles_zeros": poles,
    "frequency_response": frequency_response,
    "stabilization": stabilization,
    "convergence": search,
    "record": recording,
}
OF_POLYNOMIALS: dict[str, Callable[[DatasetResults], list[str]]] = {
    "simulation": simulation,
    "horizons": horizons,
    "residuals": residuals,
    "spectrum": spectrum,
    "delay": delay,
    "phases": phases,
}


def sentences_of(figure: str, view: View) -> list[str]:
    """The paragraphs about a figure; none where the figure and its caption say all."""
    if figure in OF_EVERY_MODEL:
        return OF_EVERY_MODEL[figure](view)
    if view.results.settings.is_single_channel and figure in OF_POLYNOMIALS:
        return OF_POLYNOMIALS[figure](view.results)
    return []
