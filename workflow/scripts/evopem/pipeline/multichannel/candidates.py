"""Candidates of several channels: every order that was searched or tried, in one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from evopem.automatic.record import Trial
from evopem.automatic.state_space_choice import ModelChoice, scores_of
from evopem.automatic.variant_search import VariantSearch
from evopem.config.structures import is_polynomial
from evopem.estimation.multi_input.order_reduction import TriedOrders

COLUMNS = (
    *("step", "form", "order", "model", "bic", "bic_with_colour"),
    *("simulation_error_percent", "free_level_error_percent", "prediction_error_percent"),
    *("selected", "reason"),
)
_SCORES = ("coloured_bic", "simulation", "free_level", "prediction")

Row = dict[str, Any]


def candidates_table(
    searches: Sequence[VariantSearch],
    choice: ModelChoice,
    orders_of: Callable[[str, int], str],
    tried: Sequence[TriedOrders],
    trials: Sequence[Trial],
) -> dict[str, list[Any]]:
    """The columns of ``candidates.csv``, one row for each candidate.

    Parameters
    ----------
    searches : sequence of VariantSearch
    choice : ModelChoice
    orders_of : callable
        The orders of a structure, in words, that follow a joint order.
    tried : sequence of TriedOrders
        Orders of each input that were tried from those of the joint order.
    trials : sequence of Trial
        Remedies of failed checks.
    """
    rows = [row for search in searches for row in _searched(search, searches, choice, orders_of)]
    rows += [_remedy(each, choice) for each in trials]
    rows += map(_reduced, tried)
    return {name: [row.get(name) for row in rows] for name in COLUMNS}


def _searched(
    search: VariantSearch,
    searches: Sequence[VariantSearch],
    choice: ModelChoice,
    orders_of: Callable[[str, int], str],
) -> Iterator[Row]:
    """The orders of one form; beyond that of the lowest BIC none is scored."""
    chosen = next(each for each in searches if each.variant == choice.variant)
    lowest = chosen.coloured_bic[chosen.orders.index(choice.order)]
    form = search.variant.form
    for order, bic in zip(search.tried, search.bic, strict=True):
        row: Row = {"step": "order", "form": search.variant.name, "order": order, "bic": bic}
        row["model"] = orders_of(form, order) if is_polynomial(form) else f"{order} states"
        row["selected"] = (search.variant, order) == (choice.variant, choice.order)
        row["reason"] = "above the order of the lowest BIC"
        if order in search.orders:
            place = search.orders.index(order)
            scores = {name: getattr(search, name)[place] for name in _SCORES}
            row["bic_with_colour"] = scores["coloured_bic"]
            row |= {f"{name}_error_percent": scores[name] for name in _SCORES[1:]}
            row["reason"] = "worse on held-out samples"
            if scores["coloured_bic"] > lowest:
                row["reason"] = "less likely than the selected one"
        if row["selected"]:
            row["reason"] = f"for {choice.purpose}: most likely of the best on held-out samples"
        yield row


def _remedy(trial: Trial, choice: ModelChoice) -> Row:
    """A model that was tried against failed checks; one that is selected replaces the choice."""
    kind = scores_of(choice.purpose, choice.level)
    outcome = "fewer checks fail" if trial.taken else "no fewer checks fail, or larger errors"
    return {
        "step": "remedy",
        "model": trial.model,
        f"{kind}_error_percent": trial.score,
        "selected": trial.taken,
        "reason": f"{trial.remedy}, as {trial.check} failed: {outcome}",
    }


def _reduced(tried: TriedOrders) -> Row:
    """Smaller orders; those of the last row that is selected are the model's."""
    reason = "lower BIC than the orders before" if tried.taken else "BIC does not fall"
    return {
        "step": "orders of each input",
        "form": tried.orders.structure,
        "order": tried.orders.plant,
        "model": str(tried.orders),
        "bic": tried.bic,
        "selected": tried.taken,
        "reason": reason,
    }
