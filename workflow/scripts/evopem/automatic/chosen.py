"""The chosen model, searched globally, and all others as candidates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.candidates import Candidate as ScoredCandidate
from evopem.automatic.candidates import OrderLimits, Scorer, with_model
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import NOISE_RADIUS, FitSettings
from evopem.automatic.preparation.plan import PreparedRecord
from evopem.automatic.state_space import (
    polynomial_settings,
    search_settings,
    task_of,
    weighting_of,
)
from evopem.automatic.structures import Choice, Kind, as_good, score_of
from evopem.config.constraints import Constraints
from evopem.config.settings import FitSettings as FocusAndConstraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.config.structures import AUTOMATIC_PHASES
from evopem.errors import InputError, NoModelError
from evopem.estimation.candidate import Candidate, PhaseSelection
from evopem.estimation.criteria import criteria_of
from evopem.estimation.estimate import estimate_polynomial
from evopem.estimation.order_scan import OrderLimits as InputLimits
from evopem.estimation.order_scan import joint_orders, refitted_estimate
from evopem.estimation.order_selection import REPEAT_FACTOR
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import PolynomialEstimate, describe, searched_objective
from evopem.estimation.search.certificate import is_certified
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult, pooled
from evopem.estimation.state_space.estimate import estimate_state_space, with_noise_model
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate, descend_from
from evopem.models.constraint_checks import check_constraints
from evopem.models.polynomial import PolynomialModel
from evopem.models.state_space import StateSpaceModel
from evopem.models.structures import Orders
from evopem.signals.recording import Recording

Array = NDArray[np.float64]
Log = Callable[[str], None]

STRUCTURES, CHOSEN = AUTOMATIC_PHASES
SUBJECT = "global search of the chosen model"
SEARCHED, COMPARED = "searched model", "compared model"
# A minimum that is lower by this share is another one.
LOWER = 1e-6


@dataclass(frozen=True, eq=False)
class ChosenModel:
    """A chosen model."""

    estimate: StateSpaceEstimate | PolynomialEstimate  # of the plant alone in output-error form
    # With the noise model beside an output-error plant; of polynomials their innovations form.
    model: StateSpaceModel
    polynomials: PolynomialModel | None = None
    at_upper_ends: tuple[str, ...] = ()  # its orders at the upper end of a range that is given


def estimate_candidate(
    candidate: ScoredCandidate,
    estimation: Recording,
    settings: FitSettings,
    limits: OrderLimits,
    fit: FocusAndConstraints | None = None,
    evaluations: int | None = None,
    log: Log | None = None,
    search: SearchSettings | None = None,
) -> ChosenModel:
    """A candidate, in the units of a recording, with its covariance and noise model.

    Its own model is among the starts; without evaluations and anything to fit it for the only one.
    ``search``: settings of a polynomial model in place of the usual ones.

    Raises InputError when no model of the order meets the constraints, and NoModelError when the
    record is too short.
    """
    if candidate.polynomials is not None:
        search = search or polynomial_settings(settings, evaluations)
        if evaluations is not None:
            search = replace(search, evaluations=evaluations)
        return _polynomials(candidate, estimation, search, limits, fit, log)
    structure, model = candidate.structure, candidate.state_space
    assert model is not None
    start = replace(
        model,
        sampling_rate=estimation.sampling_rate,
        input_names=estimation.input_names,
        output_names=estimation.output_names,
    )
    own = search_settings(settings, evaluations)
    if evaluations == 0 and fit is None:
        task = task_of(estimation, structure, candidate.delays, settings)
        estimate = descend_from(start, estimation, task)
    else:
        estimate = estimate_state_space(
            estimation,
            candidate.order,
            structure=structure,  # type: ignore[arg-type]
            delays=candidate.delays,
            weighting=weighting_of(structure, settings),
            settings=own,
            forgets=True,
            focus=fit.focus if fit else "prediction",
            constraints=fit.constraints if fit else None,
            starts=(start,),
            log=log,
        )
    found = estimate.model
    if found.structure == "ss_oe":
        found = with_noise_model(found, estimation, own)
    return ChosenModel(estimate, found)


def _polynomials(
    candidate: ScoredCandidate,
    estimation: Recording,
    search: SearchSettings,
    limits: OrderLimits,
    fit: FocusAndConstraints | None,
    log: Log | None,
) -> ChosenModel:
    ends = InputLimits.of(limits.ranges, estimation.input_names)
    orders, model = named_orders(candidate), candidate.polynomials
    assert model is not None
    if fit is not None:
        constraints = fit.constraints
        if constraints is not None and not _allowed(constraints, orders, estimation):
            orders = joint_orders(candidate.structure, candidate.order, candidate.delays, ends)
        estimate = estimate_polynomial(
            *(estimation, orders),
            settings=search,
            level=True,
            focus=fit.focus,
            constraints=constraints,
            log=log,
        )
    else:
        model = replace(model, structure=candidate.structure)
        estimate = refitted_estimate(model, estimation, search)
        if search.evaluations:
            estimate = _searched(estimate, estimation, orders, search, log)
    named = replace(
        estimate.model,
        input_names=estimation.input_names,
        output_names=estimation.output_names,
    )
    at_ends = ends.at_upper_ends(orders, estimation.input_names)
    estimate = replace(estimate, model=named)
    return ChosenModel(estimate, named.state_space(), named, at_ends)


def _searched(
    known: PolynomialEstimate,
    estimation: Recording,
    orders: Orders,
    search: SearchSettings,
    log: Log | None,
) -> PolynomialEstimate:
    """The lower one of a known optimum and of a search, of one input repeated while in doubt."""
    window = window_of(orders)
    estimate = partial(estimate_polynomial, estimation, orders, window=window, level=True, log=log)
    if orders.inputs > 1:  # which begins with descents from estimates, where nothing is known
        found = estimate(settings=search)
        both = pooled(found.search, known.search)
        return replace(known, search=both) if known.search.value < found.search.value else found
    found = estimate(settings=search, earlier=known.search)
    if not is_certified(found.search.diagnostics):
        longer = replace(search, evaluations=REPEAT_FACTOR * search.evaluations)
        found = estimate(settings=longer, earlier=found.search)
    return found


def estimate_choice(
    choice: Choice,
    scorer: Scorer,
    record: PreparedRecord,
    estimation: Recording,
    fit: FocusAndConstraints | None = None,
    evaluations: int | None = None,
    log: Log | None = None,
    search: SearchSettings | None = None,
) -> tuple[ChosenModel, Decision]:
    """The model of a choice, searched globally unless held-out samples speak against what is found.

    A lower minimum of the errors of estimation samples may be one of their noise alone: it is left
    where held-out samples are simulated, or predicted, worse with it by more than chance.

    Raises InputError when no model of the order meets the constraints, and NoModelError when the
    record is too short.
    """
    candidate = with_model(choice.candidate, record.in_its_units(choice.candidate.model))
    given = estimation, scorer.settings, scorer.limits, fit
    found = estimate_candidate(candidate, *given, evaluations, log, search)
    if fit is not None or evaluations == 0:
        return found, _about_search(choice, found, found)
    compared = estimate_candidate(candidate, *given, 0, None, search)
    value, known = (each.estimate.search.value for each in (found, compared))
    if not value < known - LOWER * abs(known):
        return found, _about_search(choice, found, compared)
    # Scores are those of scaled samples.
    rate, scales = choice.candidate.model.sampling_rate, [1.0 / each for each in record.scales]
    scaled = replace(record, sampling_rate=rate, scales=(scales[0], scales[1]))
    searched = scaled.in_its_units(found.polynomials or found.estimate.model)
    judged = scorer.scored(with_model(choice.candidate, searched))
    about = _about_search(choice, found, compared, judged)
    return (compared if about.choice == COMPARED else found), about


def _about_search(
    choice: Choice,
    found: ChosenModel,
    compared: ChosenModel,
    judged: ScoredCandidate | None = None,
) -> Decision:
    """What the search found, and whether it is taken."""
    name, known = choice.candidate.name, choice.candidate.scores
    criterion = "error on held-out samples, %"
    if judged is None:
        own = Alternative(SEARCHED, score_of(choice.kind)(choice.candidate))
        sentence = f"The search found no lower minimum than that of {name}."
        return Decision(SUBJECT, SEARCHED, (own,), criterion, sentence)
    kinds: tuple[Kind, ...] = tuple(dict.fromkeys((choice.kind, "prediction")))
    worse = [
        kind
        for kind in kinds
        if np.isfinite(getattr(known, kind)) and not as_good(judged, choice.candidate, kind)
    ]
    kind = worse[0] if worse else choice.kind
    scores = [float(getattr(each, kind)) for each in (judged.scores, known)]
    does = "predicted one step ahead" if kind == "prediction" else "simulated"
    fell = compared.estimate.search.value - found.estimate.search.value
    sentence = (
        f"The objective of {name} fell by {fell:.2g} in the search; held-out samples are {does}"
        f" with {scores[0]:.3g} % instead of {scores[1]:.3g} %"
        + (": worse by more than chance, so that the compared model is kept." if worse else ".")
    )
    alternatives = (Alternative(SEARCHED, scores[0]), Alternative(COMPARED, scores[1]))
    return Decision(SUBJECT, COMPARED if worse else SEARCHED, alternatives, criterion, sentence)


# One channel, whose results have the form of the phases of an order search.


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
    return PhaseSelection(STRUCTURES, named_orders(chosen), reason, tuple(described))


def estimate_chosen(
    choice: Choice,
    scorer: Scorer,
    record: PreparedRecord,
    data: Recording,
    search: SearchSettings,
    plant_kept: bool = False,
    log: Log | None = None,
) -> tuple[PhaseSelection, Decision]:
    """The model of a choice of one channel; with ``plant_kept`` its noise model stays as it was.

    Raises InputError when the model has roots beyond the largest radius.
    """
    candidate = choice.candidate
    orders, known = named_orders(candidate), candidate.polynomials
    assert known is not None
    if plant_kept:
        plant = replace(known, C=np.ones(1), D=np.ones(1), structure="oe")
        choice = replace(choice, candidate=replace(candidate, structure="oe", polynomials=plant))
    try:
        found, about = estimate_choice(
            *(choice, scorer, record, data, None, search.evaluations, log, search)
        )
    except NoModelError:
        raise InputError(
            "search.max_root_radius",
            f"the chosen model has a root of a radius above {search.max_root_radius:g}",
            "raise it",
        ) from None
    model = found.polynomials
    assert model is not None
    assert isinstance(found.estimate, PolynomialEstimate)
    if plant_kept:
        model = replace(model, C=known.C, D=known.D, structure=orders.structure)
    described = described_by_search(model, orders, found.estimate.search, search, data)
    reason = f"{orders} was chosen among all structures. {about.sentence}"
    return PhaseSelection(CHOSEN, orders, reason, (described,)), about


def described_by_search(
    model: PolynomialModel,
    orders: Orders,
    result: SearchResult,
    search: SearchSettings,
    data: Recording,
) -> Candidate:
    """A model as the estimate of the prepared samples, from the states that fit them."""
    radius = search.max_root_radius
    errors = PolynomialErrors(
        *(data.segments, orders, search.objective, radius, min(radius, NOISE_RADIUS), True),
        window=window_of(orders),
    )
    point = errors.completed_by_states(model)
    at_states = replace(result, point=point, value=searched_objective(errors, point))
    return Candidate.of(describe(errors, at_states, data.sampling_rate), CHOSEN)


def _described(
    scored: ScoredCandidate, record: PreparedRecord, data: Recording, first_scored: int
) -> Candidate:
    """A candidate of a structure's search with its criteria on the prepared samples."""
    model = record.in_its_units(scored.model)
    objective = record.plan.objective
    start = max(first_scored, scored.orders.first_residual)
    errors = PolynomialErrors(
        *(data.segments, scored.orders, objective, 1.0, 1.0, True),
        window=ScoringWindow(scored.orders.first_residual, start),
    )
    point, parts = errors.completed_by_states(model), errors.parts()
    residuals, outputs = errors.residuals(point), errors.scored_outputs()
    level, *further_levels = point[parts["level"]].tolist()
    criteria = criteria_of(residuals, outputs, objective, scored.parameters)
    return Candidate(
        phase=STRUCTURES,
        orders=named_orders(scored),
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


def named_orders(scored: ScoredCandidate) -> Orders:
    """Orders of polynomials with the name of their structure."""
    return replace(scored.orders, structure=scored.structure)


def _allowed(constraints: Constraints, orders: Orders, estimation: Recording) -> bool:
    """Whether a model of some orders may meet constraints."""
    try:
        check_constraints(constraints, orders, estimation.sampling_rate, estimation.input_names)
    except InputError:
        return False
    return True
