"""How many evaluations searches need: a change must not make them need half as many again.

Evaluations are counted and not timed, so that the result does not depend on the load of a machine.
After a change that is meant to cost more, ``python tests/estimation/test_evaluation_counts.py``
writes the new counts.
"""

import json
from pathlib import Path

import pytest

from evopem.config.defaults import complete
from evopem.config.order_grid import candidate_orders, phases_of_dataset, scoring_window
from evopem.config.settings import SearchSettings
from evopem.estimation.order_candidate import first_pass
from evopem.estimation.order_selection import OrderSearch, estimate_candidates, select_candidate
from evopem.models.orders import orders_of
from evopem.notebook.estimate import estimate
from evopem.synthesis import armax

BASELINE = Path(__file__).with_name("evaluation_counts.json")
ALLOWED = 1.5

SEARCHES = {
    "armax, true orders": ("armax", (7, 6, 7, 3)),
    "armax, large orders": ("armax", (10, 10, 10, 3)),
    "oe": ("oe", (7, 7, 3)),
    "bj": ("bj", (7, 4, 2, 7, 3)),
}


def search_count(name, objective):
    structure, orders = SEARCHES[name]
    record = armax(seed=4, samples=1000)[0]
    settings = SearchSettings(objective=objective, evaluations=10000)
    found = estimate(record.input, record.output, orders, structure=structure, settings=settings)
    return found.search.diagnostics.evaluations


def order_search_count(objective):
    """All phases of an order search about the true orders."""
    data = armax(seed=4, samples=2000)[0]
    search = SearchSettings(objective=objective)
    keys = {
        "synthesis": "armax",
        "recipe": "chapter",
        "search": {"objective": objective},
        "delay": {"orders": [6, 8], "nk": [2, 4]},
        "orders": {"plant": [5, 10], "nc": [5, 9], "nb": [4, 8]},
    }
    settings = complete({"datasets": {"record": keys}}).datasets["record"]
    grid = settings.order_grid
    window = scoring_window(settings)
    selection, spent = None, 0
    for phase in phases_of_dataset(settings):
        selected = selection.orders.single._asdict() if selection else None
        orders = [orders_of("armax", each) for each in candidate_orders(phase, grid, selected)]
        candidates = estimate_candidates(
            OrderSearch(data, first_pass(search), window), orders, phase
        )
        selection = select_candidate(OrderSearch(data, search, window), candidates, phase)
        spent += sum(each.diagnostics.evaluations for each in selection.candidates)
    return spent


def counts():
    """Every count by its name."""
    return {
        f"{name}, {objective}": search_count(name, objective)
        for name in SEARCHES
        for objective in ("quadratic", "absolute")
    } | {
        f"order search, {objective}": order_search_count(objective)
        for objective in ("quadratic", "absolute")
    }


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
def test_searches_need_no_more_evaluations_than_before(objective):
    # In all: last digits, which differ between kinds of processor, nearly double those of one.
    before = json.loads(BASELINE.read_text(encoding="utf-8"))
    needed = sum(search_count(name, objective) for name in SEARCHES)
    assert needed <= ALLOWED * sum(before[f"{name}, {objective}"] for name in SEARCHES)


@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
def test_an_order_search_needs_no_more_evaluations_than_before(objective):
    before = json.loads(BASELINE.read_text(encoding="utf-8"))[f"order search, {objective}"]
    assert order_search_count(objective) <= ALLOWED * before


if __name__ == "__main__":
    BASELINE.write_text(json.dumps(counts(), indent=2) + "\n", encoding="utf-8")
