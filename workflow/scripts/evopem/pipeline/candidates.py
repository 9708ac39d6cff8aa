"""Candidates: every candidate of every phase in one table."""

from __future__ import annotations

from evopem.config.structures import ORDER_NAMES
from evopem.estimation.candidate import Candidate, PhaseSelection
from evopem.files.atomic import write_table
from evopem.files.json_form import load
from evopem.results.layout import DatasetFiles


def tabulate_candidates(files: DatasetFiles, phases: tuple[str, ...]) -> None:
    """Write one row for each candidate of each phase."""
    selections = [load(PhaseSelection, files.phase(phase)) for phase in phases]
    rows = [
        _row(candidate, candidate.orders == selection.orders)
        for selection in selections
        for candidate in selection.candidates
    ]
    write_table(files.candidates, {name: [row[name] for row in rows] for name in rows[0]})


def _row(candidate: Candidate, selected: bool) -> dict[str, str | float]:
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
