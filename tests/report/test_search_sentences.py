"""Sentences on the search, for each of its outcomes."""

from dataclasses import replace

import pytest

from evopem.report.numbers import count, percent
from evopem.report.sentences import about_figures


def with_search(results, at_stability_bound=False, **changes):
    """The results, with other diagnostics of the search for the selected model."""
    record = results.model.search
    changed = replace(
        record,
        diagnostics=replace(record.diagnostics, **changes),
        at_stability_bound=at_stability_bound,
    )
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
            " leads to an undiscovered local optimum is 0.15 %",
        ),
        (
            {"generations": 3, "n_multistart": 0, "undiscovered_probability": 1.0},
            "There were no descents from random points alone",
        ),
        (
            {"convergence": ((100, 5.0), (250, 3.002), (900, 3.0))},
            "within 0.1 % of its final objective after 250 of 900 evaluations",
        ),
        ({"at_stability_bound": True}, "the bound determines it, and not the data"),
    ],
)
def test_diagnostics_of_the_search_in_words(results, changes, sentence):
    (text,) = about_figures.search(with_search(results, **changes))
    assert sentence in text
    (unchanged,) = about_figures.search(results)
    assert sentence not in unchanged


def test_the_search_of_all_candidates_in_words(results):
    (text,) = about_figures.search(results)
    table = results.candidates
    assert text.startswith(
        f"The search of {len(table)} candidates took"
        f" {count(int(table['evaluations'].sum()))} evaluations"
    )
    assert f"The state before the first residual ({results.model.orders.nc} values)" in text
    assert f"is {percent(results.model.objective, 4)}, and the fit" in text
    confirmed, bound = table["n_confirming"].gt(0), table["at_stability_bound"]
    assert bound.dtype == bool
    assert (
        f"Of all {len(table)} candidates, {confirmed.sum()} were confirmed by another restart, and"
        f" {bound.sum()} have a root at the stability bound."
    ) in text.replace("1 has", "1 have")
    one = table.assign(
        n_confirming=[1] + (len(table) - 1) * [0],
        at_stability_bound=[True] + (len(table) - 1) * [False],
    )
    (text,) = about_figures.search(replace(results, candidates=one))
    assert "1 was confirmed by another restart, and 1 has a root" in text
    assert (
        "left before the end"
        not in about_figures.search(replace(results, candidates=table.assign(pruned="")))[0]
    )
    (text,) = about_figures.search(
        replace(results, candidates=table.assign(pruned=["far"] + (len(table) - 1) * [None]))
    )
    assert "1 candidate unlikely to be selected" in text
    assert "was left before the end of the search" in text
