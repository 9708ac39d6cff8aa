"""Checks of the order search and of the search for the parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from evopem.config.structures import AUTOMATIC_PHASES, plant_order, varied_order
from evopem.estimation.search.certificate import (
    MANY_OPTIMA,
    POLYNOMIALS,
    Calibration,
    is_certified,
)
from evopem.validation.checks.check import Check

if TYPE_CHECKING:
    from evopem.estimation.candidate import PhaseSelection
    from evopem.estimation.search.problem import SearchDiagnostics

# The configuration key of the range of each phase, and the smallest value of what it varies.
RANGES = {
    "delay": ("delay.nk", 0),
    "joint": ("orders.joint", 1),
    "nc": ("orders.nc", 0),
    "nd": ("orders.nd", 0),
    "na": ("orders.na", 0),
    "nb": (".orders.nb", 1),
}
REPEATABLE = "Search repeatable"
STRUCTURES_PHASE, CHOSEN_PHASE = AUTOMATIC_PHASES


def search_ranges(phases: Mapping[str, PhaseSelection]) -> Check:
    """No selected order at an end of its range, unless the order cannot go beyond that end."""
    name = "Orders inside their search ranges"
    if STRUCTURES_PHASE in phases:
        return _grown_ranges(name, phases)
    at_end, inside, fixed = [], [], []
    for phase, selection in phases.items():
        key, least = RANGES[phase]
        order = varied_order(phase, selection.orders.structure)
        tried = [getattr(candidate.orders.single, order) for candidate in selection.candidates]
        low, high, value = min(tried), max(tried), getattr(selection.orders.single, order)
        if low == high:
            fixed.append(f"{order} = {value}")
        elif value == high or (value == low and value > least):
            at_end.append((f"{order} = {value} ({key}: {low} to {high})", key))
        else:
            inside.append(f"{order} = {value} ({key}: {low} to {high})")
    if at_end:
        return Check(
            name,
            False,
            f"At an end of the range: {'; '.join(text for text, _ in at_end)}.",
            f"Widen {', '.join(f'“{key}”' for _, key in at_end)}: a better model may lie outside.",
            "note",
        )
    if not inside:
        return Check(
            name,
            None,
            f"The configuration fixes every order: {', '.join(fixed)}.",
            "Give at least one order a range, if the orders are not known.",
        )
    remark = f" Fixed by the configuration: {', '.join(fixed)}." if fixed else ""
    return Check(name, True, f"Inside: {'; '.join(inside)}.{remark}")


def _grown_ranges(name: str, phases: Mapping[str, PhaseSelection]) -> Check:
    """The automatic recipe's ranges begin at 1 and grow until nothing is gained."""
    orders = phases[CHOSEN_PHASE].orders
    structure = orders.structure
    order = plant_order(structure)
    tried = [
        getattr(each.orders.single, order)
        for each in phases[STRUCTURES_PHASE].candidates
        if each.orders.structure == structure
    ]
    value = getattr(orders.single, order)
    if not tried:
        return Check(
            name,
            None,
            f"{orders} came of a remedy: no range of {structure.upper()} models was searched.",
            "Compare it with the candidates of the other structures.",
        )
    low, high = min(tried), max(tried)
    text = f"{order} = {value}; {order} from {low} to {high} was tried"
    if low == high:
        return Check(
            name,
            None,
            f"The configuration fixes the order: {text}.",
            "Give “orders” a range, if the orders are not known.",
        )
    if value >= high:
        return Check(
            name,
            False,
            f"At the upper end: {text}, as far as the record, the limits of the configuration and"
            " the budget go.",
            "Record longer, or give “orders.joint” a higher upper end if it was given.",
            "note",
        )
    if value == low > 1:
        return Check(
            name,
            False,
            f"At the lower end: {text}.",
            "Lower the lower end of “orders.joint”: a smaller model may be as good.",
            "note",
        )
    return Check(name, True, f"Inside: {text}, until nothing was gained.")


def repeatability(diagnostics: SearchDiagnostics, measured: Calibration = POLYNOMIALS) -> Check:
    """A certified minimum: random points or restarts agree on it as the certificate requires.

    ``measured`` says how often searches of this kind were wrong.
    """
    name = REPEATABLE
    advice = (
        "Raise “search.evaluations”, and compare the model with one of another “search.seed”. A"
        " model of lower order has fewer local minima."
    )
    others, confirming = diagnostics.n_restarts - 1, diagnostics.n_confirming
    if others < 1:
        return Check(
            name,
            None,
            "The search ended after one restart: no independent restart could confirm its minimum.",
            advice,
        )
    restarts = f"{others} other independent restart{'' if others == 1 else 's'}"
    if is_certified(diagnostics):
        rate = 100.0 * measured.largest_error_rate
        return Check(
            name,
            True,
            f"Certified: {confirming} of {restarts} reached the same minimum. Of"
            f" {measured.certified} such searches of test problems {measured.wrong or 'none'}"
            f" missed a lower minimum (at most {rate:.2g} % with 95 % confidence).",
            "",
        )
    reached = f"{confirming or 'none'} of {restarts} reached the lowest minimum"
    return Check(
        name,
        False,
        f"Not certified: {reached} that was found, too few for a certificate."
        f"{_other_minima(diagnostics)} In 95 % of such test problems a minimum found elsewhere was"
        f" at most {measured.lower_elsewhere:g} % lower.",
        advice,
        "note",
    )


def _other_minima(diagnostics: SearchDiagnostics) -> str:
    """How many minima there are beside those that were found, where there are many."""
    if not diagnostics.n_multistart or diagnostics.undiscovered_probability <= MANY_OPTIMA:
        return ""
    return (
        " There are many others: with probability"
        f" {diagnostics.undiscovered_probability:.2g} a further descent from a random point leads"
        " to one that was not found."
    )
