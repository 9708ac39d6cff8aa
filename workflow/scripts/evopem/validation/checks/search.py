"""Checks of the order search and of the search for the parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from evopem.config.structures import AUTOMATIC_PHASES, plant_order, varied_order
from evopem.estimation.search.certificate import (
    MANY_OPTIMA,
    POLYNOMIALS,
    STATE_SPACE,
    is_certified,
)
from evopem.validation.checks.check import Check, Evidence, OrderRange

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


def ranges_of_phases(phases: Mapping[str, PhaseSelection]) -> tuple[OrderRange, ...]:
    """The ranges of the orders that were searched one after the other."""
    if STRUCTURES_PHASE in phases:
        orders = phases[CHOSEN_PHASE].orders
        order = plant_order(orders.structure)
        tried = [
            getattr(each.orders.single, order)
            for each in phases[STRUCTURES_PHASE].candidates
            if each.orders.structure == orders.structure
        ]
        if not tried:
            return ()
        value = getattr(orders.single, order)
        return (OrderRange(order, "orders.joint", value, min(tried), max(tried)),)
    ranges = []
    for phase, selection in phases.items():
        key, least = RANGES[phase]
        order = varied_order(phase, selection.orders.structure)
        tried = [getattr(candidate.orders.single, order) for candidate in selection.candidates]
        value = getattr(selection.orders.single, order)
        ranges.append(OrderRange(order, key, value, min(tried), max(tried), least))
    return tuple(ranges)


def search_ranges(evidence: Evidence) -> Check:
    """No selected order at an end of its range, unless the order cannot go beyond that end.

    The automatic recipe's ranges begin at 1 and grow until nothing is gained.
    """
    name, model = "Orders inside their search ranges", evidence.model
    if not evidence.ranges:
        return Check(
            name,
            None,
            f"{model.text} came of a remedy: no range of {model.structure.upper()} models was"
            " searched.",
            "Compare it with the candidates of the other structures.",
        )
    at_end, inside, fixed = [], [], []
    for each in evidence.ranges:
        text = f"{each.name} = {each.value}"
        if each.low == each.high:
            fixed.append(text)
        elif each.value >= each.high or each.value == each.low > each.least:
            at_end.append((f"{text} ({each.key}: {each.low} to {each.high})", each.key))
        else:
            inside.append(f"{text} ({each.key}: {each.low} to {each.high})")
    at_end += [(f"{place}, in {model.text}", "orders") for place in model.at_upper_ends]
    if at_end:
        keys = dict.fromkeys(f"“{key}”" for _, key in at_end)
        return Check(
            name,
            False,
            f"At an end of the range: {'; '.join(text for text, _ in at_end)}.",
            f"Widen {', '.join(keys)}: a better model may lie outside.",
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


def repeatability(evidence: Evidence) -> Check:
    """A certified minimum: random points or restarts agree on it as the certificate requires."""
    name, diagnostics = REPEATABLE, evidence.model.search.diagnostics
    # How often searches of this kind were wrong.
    measured = STATE_SPACE if evidence.model.orders is None else POLYNOMIALS
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
