"""Sentences about the order search: delay, orders, and stabilization over the orders."""

from __future__ import annotations

import re

from evopem.config.structures import plant_order, structure_name, varied_order
from evopem.figures.orders import tied_text
from evopem.figures.view import View
from evopem.models.stabilization import PERSISTENT_ORDERS, persistent_frequencies
from evopem.report.numbers import THIN, enumeration, hertz, number, percent, plural
from evopem.results.dataset import DatasetResults

NAMES = {
    "nc": "Order of C, nc",
    "nd": "Order of D, nd",
    "na": "Order of A, na",
    "nb": "Number of B coefficients, nb",
}


def delay(results: DatasetResults) -> list[str]:
    """The selected delay, and how much BIC varies over the orders."""
    order = plant_order(results.model.orders.structure)
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
        true, found = results.truth.delay_samples, results.model.orders.single.nk
        difference = "which was found" if true == found else f"{abs(true - found)} off"
        sentences.append(f"The true delay is {plural(true, 'sample')}, {difference}.")
    return [" ".join(sentences)]


def phases(results: DatasetResults) -> list[str]:
    """The selection of each phase of the orders, beside the smallest RSS."""
    paragraphs = []
    structure = results.model.orders.structure
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
