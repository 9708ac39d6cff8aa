"""Candidates: every model that was searched or tried, in one table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from evopem.automatic.candidates import Candidate, StructureSearch
from evopem.automatic.record import Trial
from evopem.automatic.remedies import Remedied
from evopem.automatic.structures import Choice, Comparison
from evopem.config.structures import ORDER_NAMES
from evopem.estimation.candidate import Candidate as PhaseCandidate
from evopem.estimation.candidate import PhaseSelection
from evopem.files.atomic import write_table
from evopem.files.json_form import load
from evopem.results.layout import DatasetFiles

COLUMNS = (
    *("step", "structure", "order", "model", "bic"),
    *("simulation_error_percent", "fitted_level_error_percent", "prediction_error_percent"),
    *("selected", "reason"),
)
Row = dict[str, Any]


def tabulate_candidates(
    files: DatasetFiles, phases: tuple[str, ...], structures: tuple[str, ...]
) -> None:
    """Write ``candidates.csv``, one row for each candidate of each phase or structure."""
    rows = _of_phases(files, phases) if phases else _of_structures(files, structures)
    columns = list(rows[0]) if phases else COLUMNS
    write_table(files.candidates, {name: [row.get(name) for row in rows] for name in columns})


def _of_phases(files: DatasetFiles, phases: tuple[str, ...]) -> list[Row]:
    selections = [load(PhaseSelection, files.phase(phase)) for phase in phases]
    return [
        _of_phase(candidate, candidate.orders == selection.orders)
        for selection in selections
        for candidate in selection.candidates
    ]


def _of_phase(candidate: PhaseCandidate, selected: bool) -> Row:
    orders, criteria, diagnostics = candidate.orders, candidate.criteria, candidate.diagnostics
    return {
        "phase": candidate.phase,
        "model": str(orders),
        **{name: getattr(orders.single, name) for name in ORDER_NAMES},
        "rss": criteria.rss,
        "bic": criteria.bic,
        "objective": criteria.objective,
        "evaluations": diagnostics.evaluations,
        "max_pole_radius": candidate.max_pole_radius,
        "selected": selected,
        "max_noise_zero_radius": candidate.max_noise_zero_radius,
        "n_restarts": diagnostics.n_restarts,
        "n_confirming": diagnostics.n_confirming,
        "n_local_optima": diagnostics.n_local_optima,
        "at_stability_bound": candidate.at_stability_bound,
        "n_multistart": diagnostics.n_multistart,
        "undiscovered_probability": diagnostics.undiscovered_probability,
        "pruned": candidate.pruned,
    }


def _of_structures(files: DatasetFiles, structures: tuple[str, ...]) -> list[Row]:
    searches = [load(StructureSearch, files.search(each)) for each in structures]
    comparison = load(Comparison, files.decision("comparison"))
    remedied = load(Remedied, files.decision("remedies"))
    choice = comparison.choice(remedied.choice.purpose)
    rows = list(_searched(searches, comparison, choice))
    return rows + [_remedy(each, choice) for each in remedied.trials]


def _searched(
    searches: Sequence[StructureSearch], comparison: Comparison, choice: Choice
) -> Iterator[Row]:
    """The orders of all structures, and those that were refined; not all of them are scored."""
    names = {each.name for search in searches for each in search.candidates}
    refined = [each for each in comparison.candidates if each.name not in names]
    for step, listed in (
        ("order", [each for search in searches for each in search.candidates]),
        ("orders of each input", refined),
    ):
        for each in listed:
            row: Row = {
                "step": step,
                "structure": each.structure,
                "order": each.order,
                "model": each.name,
                "bic": each.bic,
                "selected": each.name == choice.candidate.name,
                "reason": _reason(each, choice),
            }
            if each.is_scored:
                scores = vars(each.scores).items()
                row |= {f"{kind}_error_percent": score for kind, score in scores}
            yield row


def _reason(candidate: Candidate, choice: Choice) -> str:
    if candidate.name == choice.candidate.name:
        return f"for {choice.purpose}: most likely of the best on held-out samples"
    if not candidate.is_scored:
        return "above the order of the lowest BIC"
    if candidate.bic > choice.candidate.bic:
        return "less likely than the selected one"
    return "worse on held-out samples"


def _remedy(trial: Trial, choice: Choice) -> Row:
    """A model that was tried against failed checks; one that is selected replaces the choice."""
    outcome = "fewer checks fail" if trial.taken else "no fewer checks fail, or larger errors"
    return {
        "step": "remedy",
        "model": trial.model,
        f"{choice.kind}_error_percent": trial.score,
        "selected": trial.taken,
        "reason": f"{trial.remedy}, as {trial.check} failed: {outcome}",
    }
