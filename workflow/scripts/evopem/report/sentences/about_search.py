"""Sentences about the search: its cost, and how far its optimum was confirmed."""

from __future__ import annotations

import pandas as pd

from evopem.estimation.search.problem import SearchDiagnostics
from evopem.report.numbers import count, is_number, number, percent, plural
from evopem.results.dataset import DatasetResults

# The search counts as near its final objective from this ratio on.
NEAR = 1.001


def search(results: DatasetResults) -> list[str]:
    """Evaluations of all searches, and the diagnostics of the search for the selected model."""
    model = results.model
    diagnostics = model.search.diagnostics
    evaluations = int(results.candidates["evaluations"].sum())
    sentences = [
        f"The search of {plural(len(results.candidates), 'candidate')} took {count(evaluations)}"
        " evaluations of the objective.",
        *([] if _descents_only(diagnostics) else _convergence(diagnostics)),
        f"Its objective (“{model.search.settings.objective}”) is"
        f" {percent(model.criteria.objective, 4)}, and the fit on the estimation samples"
        f" {percent(model.criteria.fit_percent, 4)}.",
        _restarts(diagnostics),
        "The descents that converged ended at"
        f" {plural(diagnostics.n_local_optima, 'local optimum', 'distinct local optima')}.",
        *([] if _descents_only(diagnostics) else [_multistart(diagnostics)]),
    ]
    if model.search.at_stability_bound and not model.may_be_unstable:
        sentences.append(
            "A root of A, C, D or F lies at the stability bound, the largest radius allowed: the"
            " bound determines it, and not the data."
        )
    for state, words in ((model.plant_state, "plant"), (model.noise_state, "noise")):
        if state.size:
            sentences.append(
                f"The {words} state before the first residual ({plural(state.size, 'value')}) was"
                " estimated with the coefficients, so no initial transient adds to the residuals."
            )
    sentences.append(_all_candidates(results.candidates))
    return [" ".join(sentences)]


def _convergence(diagnostics: SearchDiagnostics) -> list[str]:
    history = diagnostics.convergence
    if not history or history[-1][1] <= 0:
        return []
    spent, final = history[-1]
    near = next(evaluations for evaluations, value in history if value <= NEAR * final)
    return [
        "The search of the selected model was within 0.1 % of its final objective after"
        f" {count(near)} of {count(spent)} evaluations."
    ]


def _descents_only(diagnostics: SearchDiagnostics) -> bool:
    """Whether a model was fitted without a search of its own, from one that was found before."""
    return diagnostics.generations == 0 and diagnostics.n_multistart == 0


def _restarts(diagnostics: SearchDiagnostics) -> str:
    others = diagnostics.n_restarts - 1
    if _descents_only(diagnostics):
        return (
            "The model was then fitted for its focus and constraints by descents from"
            f" {plural(diagnostics.n_restarts, 'point')};"
            f" {diagnostics.n_confirming} beside the best ended at the same optimum."
        )
    if others < 1:
        return "The search had a single restart, so no other restart confirms the optimum."
    return (
        f"The search had {diagnostics.n_restarts} independent restarts;"
        f" {diagnostics.n_confirming} of the {others} beside the best ended at the same optimum."
    )


def _multistart(diagnostics: SearchDiagnostics) -> str:
    if diagnostics.n_multistart == 0 or not is_number(diagnostics.undiscovered_probability):
        return "There were no descents from random points alone."
    return (
        "Some of them were batches of descents from"
        f" {count(diagnostics.n_multistart)} random points: the estimated probability that a"
        " further descent leads to an undiscovered local optimum is"
        f" {number(100.0 * diagnostics.undiscovered_probability, 2)} %."
    )


def _all_candidates(candidates: pd.DataFrame) -> str:
    confirmed = int((candidates["n_confirming"] > 0).sum())
    bound = int(candidates["at_stability_bound"].sum())
    left = int(candidates["pruned"].astype("string").fillna("").ne("").sum())
    pruned = (
        f" {plural(left, 'candidate')} unlikely to be selected"
        f" {'was' if left == 1 else 'were'} left before the end of the search."
    )
    return (
        f"Of all {plural(len(candidates), 'candidate')}, {count(confirmed)}"
        f" {'was' if confirmed == 1 else 'were'} confirmed by another restart, and"
        f" {count(bound)} {'has' if bound == 1 else 'have'} a root at the stability bound. The"
        " objective of a candidate that was not confirmed may lie above its global minimum, and its"
        " criteria with it." + (pruned if left else "")
    )
