"""The chosen model, estimated once more by the global search, and all others as candidates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.candidates import Candidate as ScoredCandidate
from evopem.automatic.fit import NOISE_RADIUS, fit_at
from evopem.automatic.preparation.plan import PreparedRecord
from evopem.automatic.remedies import Remedied
from evopem.automatic.structures import Choice
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.config.structures import AUTOMATIC_PHASES
from evopem.errors import InputError
from evopem.estimation.candidate import Candidate, PhaseSelection
from evopem.estimation.criteria import criteria_of
from evopem.estimation.order_selection import REPEAT_FACTOR
from evopem.estimation.pem.stretch_errors import StretchErrors
from evopem.estimation.polynomial_estimate import describe
from evopem.estimation.search.certificate import is_certified
from evopem.estimation.search.global_search import global_search
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import (
    SearchDiagnostics,
    SearchResult,
    descended,
    pooled,
)
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Recording

Array = NDArray[np.float64]

STRUCTURES, CHOSEN = AUTOMATIC_PHASES


def window_of(orders: Orders) -> ScoringWindow:
    """The chosen model counts every residual whose past is measured."""
    return ScoringWindow(orders.first_residual, orders.first_residual)


def select_structure(
    candidates: Sequence[ScoredCandidate],
    chosen: ScoredCandidate,
    reason: str,
    record: PreparedRecord,
    data: Recording,
    first_scored: int,
) -> PhaseSelection:
    """All candidates of all structures on the same samples, and the one that was chosen."""
    described = [_described(each, record, data, first_scored) for each in candidates]
    orders = _named_orders(chosen)
    return PhaseSelection(STRUCTURES, orders, reason, tuple(described))


def estimate_chosen(
    remedied: Remedied,
    record: PreparedRecord,
    data: Recording,
    search: SearchSettings,
    log: Callable[[str], None] | None = None,
) -> PhaseSelection:
    """Search the chosen orders globally, from the chosen model and from independent starts.

    Where the noise model was fitted to the errors of simulation of a plant, the plant is searched
    by itself and the noise model stays.

    Raises InputError when no start has finite prediction errors.
    """
    chosen = remedied.choice.candidate
    orders = _named_orders(chosen)
    searched, model = orders, _polynomials(chosen)
    if remedied.plant_kept:
        searched = Orders(
            nb=orders.single.nb, nf=orders.single.nf, nk=orders.single.nk, structure="oe"
        )
        model = replace(model, C=np.ones(1), D=np.ones(1), structure="oe")
    errors = _errors_of(record, searched, search)
    known = _nearest_optimum(errors, model, search)
    result = _searched(errors, known, search, 1, log)
    if not is_certified(result.diagnostics):
        longer = replace(search, evaluations=REPEAT_FACTOR * search.evaluations)
        result = _searched(errors, result, longer, 2, log)
    best = _model_at(errors, result.point, searched.structure)
    if remedied.plant_kept:
        noise = _polynomials(chosen)
        best = replace(best, C=noise.C, D=noise.D, structure=orders.structure)
    candidate = _described_by_search(record.in_its_units(best), orders, result, search, data)
    lower = known.value - result.value
    reason = f"{orders} was chosen among all structures, and searched globally: " + (
        f"its objective fell by {lower:.2g} percentage points."
        if lower > 1e-6 * abs(known.value)
        else "no lower minimum than that of the chosen model was found."
    )
    return PhaseSelection(CHOSEN, orders, reason, (candidate,))


def estimate_choice(
    choice: Choice, record: PreparedRecord, data: Recording, search: SearchSettings
) -> Candidate:
    """The model of a choice on the prepared samples, at the optimum that the comparison found.

    Raises InputError when the model has roots beyond the largest radius.
    """
    orders = _named_orders(choice.candidate)
    errors = _errors_of(record, orders, search)
    known = _nearest_optimum(errors, _polynomials(choice.candidate), search)
    model = record.in_its_units(_model_at(errors, known.point, orders.structure))
    return _described_by_search(model, orders, known, search, data)


def _errors_of(record: PreparedRecord, orders: Orders, search: SearchSettings) -> StretchErrors:
    return StretchErrors(
        *(record.stretches, orders, search.objective, search.max_root_radius),
        *(min(search.max_root_radius, NOISE_RADIUS), True),
    )


def _nearest_optimum(
    errors: StretchErrors, model: PolynomialModel, search: SearchSettings
) -> SearchResult:
    """The optimum that a descent from a model reaches."""
    starts = PolynomialProblem(errors, [model], own_starts=False).starts()
    if len(starts) == 0:
        raise InputError(
            "search.max_root_radius",
            f"the chosen model has a root of a radius above {search.max_root_radius:g}",
            "raise it",
        )
    return descended(PolynomialProblem(errors), starts[0])


def _searched(
    errors: StretchErrors,
    earlier: SearchResult,
    search: SearchSettings,
    number: int,
    log: Callable[[str], None] | None,
) -> SearchResult:
    """A global search, combined with an earlier one; its draws are keyed by orders and number."""
    problem, o = PolynomialProblem(errors), errors.orders
    key = (o.na, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk, number)
    generator = np.random.default_rng(np.random.SeedSequence(search.seed, spawn_key=key))
    found = global_search(
        problem, search, generator, log, earlier.value, recombine=problem.recombine
    )
    return pooled(earlier, found)


def _described_by_search(
    model: PolynomialModel,
    orders: Orders,
    result: SearchResult,
    search: SearchSettings,
    data: Recording,
) -> Candidate:
    """A model as the estimate of the prepared samples, from the states that fit them."""
    radius = search.max_root_radius
    errors = StretchErrors(
        *(data.segments, orders, search.objective, radius, min(radius, NOISE_RADIUS), True),
        window=window_of(orders),
    )
    at_states = replace(result, point=errors.completed_by_states(model))
    return Candidate.of(describe(errors, at_states, data.sampling_rate), CHOSEN)


def _described(
    scored: ScoredCandidate, record: PreparedRecord, data: Recording, first_scored: int
) -> Candidate:
    """A candidate of a structure's search with its criteria on the prepared samples."""
    model = record.in_its_units(_polynomials(scored))
    objective = record.plan.objective
    start = max(first_scored, scored.orders.first_residual)
    errors = StretchErrors(
        *(data.segments, scored.orders, objective, 1.0, 1.0, True),
        window=ScoringWindow(scored.orders.first_residual, start),
    )
    point, parts = errors.completed_by_states(model), errors.parts()
    residuals, outputs = errors.residuals(point), errors.scored_outputs()
    level, *further_levels = point[parts["level"]].tolist()
    criteria = criteria_of(residuals, outputs, objective, scored.parameters)
    return Candidate(
        phase=STRUCTURES,
        orders=_named_orders(scored),
        model=replace(model, level=level),
        criteria=criteria,
        with_level=True,
        plant_state=point[parts["plant"]],
        noise_state=point[parts["noise"]],
        minimum=criteria.objective,
        at_stability_bound=False,
        diagnostics=SearchDiagnostics.none(),
        further_levels=tuple(further_levels),
    )


def _model_at(errors: StretchErrors, point: Array, structure: str) -> PolynomialModel:
    model = fit_at(errors, point, structure).model
    assert isinstance(model, PolynomialModel)
    return model


def _polynomials(scored: ScoredCandidate) -> PolynomialModel:
    assert scored.polynomials is not None
    return scored.polynomials


def _named_orders(scored: ScoredCandidate) -> Orders:
    return replace(scored.orders, structure=scored.structure)
