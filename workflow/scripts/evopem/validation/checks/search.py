"""Checks of the order search and of the search for the parameters."""

from collections.abc import Mapping

from evopem.config.structures import REGULARISED, varied_order
from evopem.estimation.order_candidate import PhaseSelection
from evopem.estimation.search import certificate
from evopem.validation.checks.check import Evidence, Found, OrderRange, check

# The configuration key of the range of each phase, and the smallest value of what it varies.
RANGES = {
    "delay": ("delay.nk", 0),
    "plant": ("orders.plant", 1),
    "nc": ("orders.nc", 0),
    "nd": ("orders.nd", 0),
    "na": ("orders.na", 0),
    "nb": ("orders.nb", 1),
}
REPEATABLE = "Search repeatable"
# Other restarts which, when all of them end at the lowest value, show that a search is repeatable.
REPEATED = 4


def ranges_of_phases(phases: Mapping[str, PhaseSelection]) -> tuple[OrderRange, ...]:
    """The ranges of the orders that were searched one after the other."""
    ranges = []
    for phase, selection in phases.items():
        key, least = RANGES[phase]
        order = varied_order(phase, selection.orders.structure)
        tried = [getattr(candidate.orders.single, order) for candidate in selection.candidates]
        value = getattr(selection.orders.single, order)
        ranges.append(OrderRange(order, key, value, min(tried), max(tried), least))
    return tuple(ranges)


@check("Orders inside their search ranges", grade="note")
def search_ranges(evidence: Evidence) -> Found | None:
    """No selected order at an end of its range, unless the order cannot go beyond that end.

    The automatic recipe's ranges begin at 1, of many states of outputs alone eight below those of
    their likeliest subspace estimate, and grow until nothing is gained.  The length of a
    regularised response is no order, and an estimate has the orders that were given.
    """
    model = evidence.model
    if model.structure in REGULARISED or not model.transforms.holds_out:
        return None
    if not evidence.ranges:
        kind = model.structure.upper()
        statement = f"{model.text} came of a remedy: no range of {kind} models was searched."
        return None, statement, "Compare it with the candidates of the other structures."
    at_end, inside, fixed = [], [], []
    for span in evidence.ranges:
        text = f"{span.name} = {span.value}"
        if span.low == span.high:
            fixed.append(text)
        elif span.value >= span.high or span.value == span.low > span.least:
            at_end.append((f"{text} ({span.key}: {span.low} to {span.high})", span.key))
        else:
            inside.append(f"{text} ({span.key}: {span.low} to {span.high})")
    at_end += [(f"{place}, in {model.text}", "orders") for place in model.at_upper_ends]
    if at_end:
        keys = dict.fromkeys(f"“{key}”" for _, key in at_end)
        statement = f"At an end of the range: {'; '.join(text for text, _ in at_end)}."
        return False, statement, f"Widen {', '.join(keys)}: a better model may lie outside."
    if not inside:
        remedy = "Give at least one order a range, if the orders are not known."
        return None, f"The configuration fixes every order: {', '.join(fixed)}.", remedy
    remark = f" Fixed by the configuration: {', '.join(fixed)}." if fixed else ""
    return True, f"Inside: {'; '.join(inside)}.{remark}"


@check(
    REPEATABLE,
    "Raise “search.evaluations”, and compare the model with one of another “search.seed”. A model"
    " of lower order has fewer local minima.",
    "note",
)
def repeatability(evidence: Evidence) -> Found | None:
    """A certified minimum, or one that every restart of several reached.

    A regularised response is not searched.
    """
    if evidence.model.structure in REGULARISED:
        return None
    diagnostics = evidence.model.search.diagnostics
    # How often searches of this kind were wrong.
    measured = certificate.STATE_SPACE if evidence.model.orders is None else certificate.POLYNOMIALS
    others, confirming = diagnostics.n_restarts - 1, diagnostics.n_confirming
    if others < 1:
        ended = f"The search ended after {'one restart' if others == 0 else 'descents'}"
        return None, f"{ended}: no independent restart could confirm its minimum."
    restarts = f"{others} other independent restart{'' if others == 1 else 's'}"
    if certificate.is_certified(diagnostics, measured is certificate.POLYNOMIALS):
        return (
            True,
            f"Certified: {confirming} of {restarts} reached the same minimum. Of"
            f" {measured.certified} such searches of test problems {measured.wrong or 'none'}"
            f" missed a lower minimum (at most {100.0 * measured.largest_error_rate:.2g} % with"
            " 95 % confidence).",
        )
    others_found = ""
    if diagnostics.n_multistart and diagnostics.undiscovered_probability > certificate.MANY_OPTIMA:
        others_found = (
            " There are many others: with probability"
            f" {diagnostics.undiscovered_probability:.2g} a further descent from a random point"
            " leads to one that was not found."
        )
    repeated = confirming == others >= REPEATED
    few = "" if repeated else ", too few for a certificate"
    if certificate.has_agreed(diagnostics, measured is certificate.POLYNOMIALS):
        few = ", few where the record does not support all orders"
    return (
        repeated,
        f"{'Repeatable, but not' if repeated else 'Not'} certified: {confirming or 'none'} of"
        f" {restarts} reached the lowest minimum that was found{few}.{others_found} In 95 %"
        " of such test problems a minimum found elsewhere was at most"
        f" {measured.lower_elsewhere:g} % lower.",
    )
