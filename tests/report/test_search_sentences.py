"""Sentences on the search, for each of its outcomes."""

from dataclasses import replace

import pytest
from browsing import told

from evopem.report.numbers import count, percent


def with_search(results, **changes):
    """The results, with other diagnostics of the search for the selected model."""
    record = results.model.search
    changed = replace(record, diagnostics=replace(record.diagnostics, **changes))
    return replace(results, model=replace(results.model, search=changed))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"generations": 9, "restart_minima": (3.0, 3.0, 3.0, 4.0), "n_confirming": 2},
            "The search had 4 independent restarts; 2 of the 3 beside the best",
        ),
        (
            {"generations": 1, "restart_minima": (3.0,), "n_confirming": 0},
            "The search had a single restart, so no other restart confirms",
        ),
        ({"n_local_optima": 77}, "ended at 77 distinct local optima"),
        (
            {"n_multistart": 64, "undiscovered_probability": 0.0015},
            "descents from 64 random points: the estimated probability that a further descent"
            " leads to an undiscovered local optimum is 0.15\u202f%",
        ),
        (
            {"generations": 3, "n_multistart": 0, "undiscovered_probability": 1.0},
            "There were no descents from random points alone",
        ),
        (
            {"convergence": ((100, 5.0), (250, 3.002), (900, 3.0))},
            "within 0.1 % of its final objective after 250 of 900 evaluations",
        ),
        (
            {"generations": 0, "n_multistart": 0, "restart_minima": (3.0, 3.0), "n_confirming": 1},
            "fitted by descents from 2 points; 1 beside the best ended at the same optimum",
        ),
    ],
)
def test_diagnostics_of_the_search_in_words(results, changes, sentence):
    (text,) = told("convergence", with_search(results, **changes))
    assert sentence in text
    (unchanged,) = told("convergence", results)
    assert sentence not in unchanged


def test_the_search_of_all_candidates_in_words(results):
    (text,) = told("convergence", results)
    table = results.candidates
    assert text.startswith(
        f"The search of {len(table)} candidates took"
        f" {count(int(table['evaluations'].sum()))} evaluations of the objective;"
        f" {table['n_confirming'].gt(0).sum()} of them were confirmed by another restart."
    )
    assert f"The state before the first residual ({results.model.orders.nc} values)" in text
    assert f"is {percent(results.model.objective, 4)}." in text
