"""The chosen model, searched globally unless held-out samples speak against what is found."""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from evopem.arrays import one_blas_thread
from evopem.automatic.candidates import Candidate, Scorer
from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.fit import NOISE_RADIUS, PLANT_RADIUS, task_of, weighting_of
from evopem.automatic.fold_errors import Kind, as_good, score_of
from evopem.automatic.orders import orders_of_size
from evopem.automatic.preparation.plan import PreparedRecord
from evopem.automatic.structures import Choice
from evopem.config.constraints import Constraints
from evopem.config.settings import AutomaticSettings, FitSettings, ScoringWindow, SearchSettings
from evopem.config.structures import REGULARISED
from evopem.errors import InputError, LostModelError, NoModelError
from evopem.estimation.estimate import estimate_polynomial
from evopem.estimation.impulse_response import estimate_response
from evopem.estimation.order_selection import REPEAT_FACTOR
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import PolynomialEstimate, describe, searched_objective
from evopem.estimation.prediction_errors import checked_errors
from evopem.estimation.prediction_estimate import optimum_next_to
from evopem.estimation.search.certificate import has_agreed
from evopem.estimation.search.problem import Log, SearchResult, pooled
from evopem.estimation.state_space.estimate import estimate_state_space, with_noise_model
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate, descend_from
from evopem.models.constraint_checks import check_constraints
from evopem.models.orders import Orders
from evopem.models.polynomial import Model, PolynomialModel, of_signals
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording

SUBJECT = "global search of the chosen model"
SEARCHED, COMPARED = "searched model", "compared model"
# Evaluations of the search of a polynomial model of several inputs, where none are given.
POLYNOMIAL_EVALUATIONS = 10_000
LOWER = 1e-6  # a minimum that is lower by this share is another one


@dataclass(frozen=True, eq=False)
class ChosenModel:
    """A chosen model."""

    estimate: StateSpaceEstimate | PolynomialEstimate  # of the plant alone in output-error form
    model: Model  # with the noise model beside an output-error plant in state space
    largest_radius: float  # that its roots were allowed
    at_upper_ends: tuple[str, ...] = ()  # its orders at the upper end of a range that is given


def searches_of(
    candidate: Candidate, search: SearchSettings, settings: AutomaticSettings
) -> tuple[SearchSettings, SearchSettings]:
    """The settings of the search for a candidate, and the same with its evaluations."""
    evaluations = settings.evaluations
    if candidate.polynomials is not None:
        if settings.max_root_radius is None:
            search = replace(search, max_root_radius=PLANT_RADIUS)
        if evaluations is None and len(candidate.delays) > 1:
            evaluations = POLYNOMIAL_EVALUATIONS
    return search, search if evaluations is None else replace(search, evaluations=evaluations)


def estimate_candidate(
    candidate: Candidate,
    estimation: Recording,
    scorer: Scorer,
    search: SearchSettings,
    fit: FitSettings | None = None,
    log: Log | None = None,
    bare: bool = False,
) -> ChosenModel:
    """A candidate, in the units of a recording, with its covariance and noise model.

    Its own model is among the starts; without evaluations and anything to fit it for the only one,
    in state space ``bare`` of covariance and noise model, where only its minimum counts.

    InputError when no model of the order meets the constraints, NoModelError of a short record.
    """
    if candidate.polynomials is not None:
        estimate, bound, ends = _polynomials(candidate, estimation, scorer, search, fit, log)
        model = of_signals(estimate.model, estimation)
        return ChosenModel(replace(estimate, model=model), model, bound, ends)
    assert isinstance(candidate.model, StateSpaceModel)
    start = of_signals(candidate.model, estimation)
    given = candidate.structure, candidate.delays
    if search.evaluations == 0 and fit is None:
        task = task_of(estimation, *given, scorer.settings)
        fitted = descend_from(start, estimation, replace(task, covariances=not bare))
    else:
        fitted = estimate_state_space(
            estimation,
            candidate.order,
            structure=candidate.structure,  # type: ignore[arg-type]
            delays=candidate.delays,
            weighting=weighting_of(candidate.structure, scorer.settings),
            settings=search,
            forgets=True,
            focus=fit.focus if fit else "prediction",
            constraints=fit.constraints if fit else None,
            starts=(start,),
            log=log,
        )
    states = fitted.model
    if states.structure == "ss_oe" and not bare:
        states = with_noise_model(states, estimation, search)
    return ChosenModel(fitted, states, search.max_root_radius)


def _polynomials(
    candidate: Candidate,
    estimation: Recording,
    scorer: Scorer,
    search: SearchSettings,
    fit: FitSettings | None,
    log: Log | None,
) -> tuple[PolynomialEstimate, float, tuple[str, ...]]:
    orders, model = replace(candidate.orders, structure=candidate.structure), candidate.polynomials
    assert model is not None
    bound = search.max_root_radius
    if fit is not None:
        constraints = fit.constraints
        if constraints is not None and not _allowed(constraints, orders, estimation):
            same = orders_of_size(candidate.structure, candidate.order, candidate.delays)[0]
            orders = replace(
                scorer.limits.clamped(candidate.structure, same), structure=candidate.structure
            )
        estimate = estimate_polynomial(
            *(estimation, orders),
            settings=search,
            window=window_of(orders),
            level=True,
            focus=fit.focus,
            constraints=constraints,
            log=log,
        )
    else:
        model = replace(model, structure=candidate.structure)
        estimate = _optimum(model, estimation, search, log)
        while 0.95 < bound < 1.0 <= np.abs(estimate.model.poles()).max(initial=0.0):
            # Coefficients of many poles near 1 are rounded to those of a pole beyond the bound.
            inside = replace(search, max_root_radius=1.0 - 10.0 * (1.0 - bound))
            try:
                estimate = _optimum(model, estimation, inside, log)
            except LostModelError:
                raise
            except InputError:
                break  # no descent begins so far inside: checks say that the model is unstable
            bound = inside.max_root_radius
    return estimate, bound, scorer.limits.at_upper_ends(orders)


def _optimum(
    model: PolynomialModel, estimation: Recording, search: SearchSettings, log: Log | None
) -> PolynomialEstimate:
    """The optimum next to a model, or a lower one of a search; InputError beyond its radius."""
    try:
        estimate = refitted_estimate(model, estimation, search)
    except LostModelError:
        raise
    except NoModelError:
        problem = f"the chosen model has a root of a radius above {search.max_root_radius:g}"
        raise InputError("search.max_root_radius", problem, "raise it") from None
    if search.evaluations and model.structure not in REGULARISED:
        estimate = _searched(estimate, estimation, model.orders, search, log)
    return estimate


def refitted_estimate(
    model: PolynomialModel, recording: Recording, settings: SearchSettings
) -> PolynomialEstimate:
    """The optimum of a recording that a descent from a model ends at, or NoModelError.

    The model itself, with the states that fit it, where rounding spoils the optimum.
    """
    with one_blas_thread():
        window = window_of(model.orders)
        errors = checked_errors(recording, model.orders, settings, window, level=True)
        if model.structure in REGULARISED:
            return estimate_response(errors, recording.sampling_rate)
        optimum = optimum_next_to(model, errors)
        if optimum is None:
            raise NoModelError("the descent found no finite errors")
        with suppress(LostModelError):
            return describe(errors, optimum, recording.sampling_rate, shortest=True)
    return described_by_search(model, optimum, settings, recording)


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
        result = estimate(settings=search)
        both = pooled(result.search, known.search)
        return replace(known, search=both) if known.search.value < result.search.value else result
    result = estimate(settings=search, earlier=known.search)
    if not has_agreed(result.search.diagnostics):
        longer = replace(search, evaluations=REPEAT_FACTOR * search.evaluations)
        result = estimate(settings=longer, earlier=result.search)
    return result


def estimate_choice(
    choice: Choice,
    scorer: Scorer,
    record: PreparedRecord,
    estimation: Recording,
    search: SearchSettings,
    fit: FitSettings | None = None,
    plant_kept: bool = False,
    log: Log | None = None,
) -> tuple[ChosenModel, Decision]:
    """The model of a choice, searched globally unless held-out samples speak against what is found.

    A lower minimum of the errors of estimation samples may be one of their noise alone: it is left
    where held-out samples are simulated, or predicted, worse with it (:func:`.as_good`), however
    likely it is.  With ``plant_kept`` the plant is searched without its noise model, which stays.

    Raises InputError when no model of the order meets the constraints, or the model has roots
    beyond the largest radius, and NoModelError when the record is too short.
    """
    noise = choice.candidate.polynomials
    if plant_kept and fit is None and noise is not None:
        plant = replace(noise, C=np.ones(1), D=np.ones(1), structure="oe")
        alone = replace(choice, candidate=replace(choice.candidate, structure="oe", model=plant))
        with suppress(LostModelError):  # of a plant that rounding leaves both are searched
            kept, about = estimate_choice(alone, scorer, record, estimation, search, log=log)
            assert isinstance(kept.model, PolynomialModel)
            model = replace(kept.model, C=noise.C, D=noise.D, structure="bj", covariance=None)
            estimate = described_by_search(model, kept.estimate.search, search, estimation)
            return replace(kept, estimate=estimate, model=estimate.model), about
    candidate = replace(choice.candidate, model=record.in_its_units(choice.candidate.model))
    try:
        searched_model = estimate_candidate(candidate, estimation, scorer, search, fit, log)
    except LostModelError:
        if fit is not None or search.evaluations == 0:
            raise
        # The optimum of the compared model may be one that rounding leaves.
        search = replace(search, evaluations=0)
        searched_model = estimate_candidate(candidate, estimation, scorer, search)
    if fit is not None or search.evaluations == 0:
        return searched_model, _about_search(choice, searched_model, searched_model)
    known_one = candidate, estimation, scorer, replace(search, evaluations=0)
    try:
        compared = estimate_candidate(*known_one, bare=True)
    except NoModelError:
        # With its outputs fitted anew, the compared model may have a pole beyond the bound.
        return searched_model, _about_search(choice, searched_model, searched_model)
    value, known = (model.estimate.search.value for model in (searched_model, compared))
    if not value < known - LOWER * abs(known):
        return searched_model, _about_search(choice, searched_model, compared)
    # Scores are those of scaled samples.
    rate, scales = choice.candidate.model.sampling_rate, [1.0 / scale for scale in record.scales]
    scaled = replace(record, sampling_rate=rate, scales=(scales[0], scales[1]))
    searched = scaled.in_its_units(searched_model.estimate.model)
    judged = scorer.scored(replace(choice.candidate, model=searched))
    about = _about_search(choice, searched_model, compared, judged)
    return (estimate_candidate(*known_one) if about.choice == COMPARED else searched_model), about


def described_by_search(
    model: PolynomialModel, result: SearchResult, search: SearchSettings, data: Recording
) -> PolynomialEstimate:
    """A model as the estimate of the prepared samples, from the states that fit them."""
    radius = search.max_root_radius
    errors = PolynomialErrors(
        *(data.segments, model.orders, search.objective, radius, min(radius, NOISE_RADIUS), True),
        window=window_of(model.orders),
    )
    point = errors.completed_by_states(model.parameters)
    at_states = replace(result, point=point, value=searched_objective(errors, point))
    estimate = describe(errors, at_states, data.sampling_rate, shortest=True)
    return replace(estimate, model=of_signals(estimate.model, data))


def _about_search(
    choice: Choice, result: ChosenModel, compared: ChosenModel, judged: Candidate | None = None
) -> Decision:
    """What the search found, and whether it is taken."""
    name, known = choice.candidate.name, choice.candidate.scores
    criterion = "error on held-out samples, %"
    if judged is None:
        alternative = Alternative(SEARCHED, score_of(choice.kind)(choice.candidate))
        sentence = f"The search found no lower minimum than that of {name}."
        if choice.candidate.structure in REGULARISED:
            sentence = "A regularised response has one optimum, which needs no search."
        return Decision(SUBJECT, SEARCHED, (alternative,), criterion, sentence)
    both: tuple[Kind, ...] = choice.kind, "prediction"
    kinds = [kind for kind in dict.fromkeys(both) if np.isfinite(getattr(known, kind))]
    worse = [kind for kind in kinds if not as_good(judged, choice.candidate, kind)]
    kind = [*worse, *kinds, choice.kind][0]
    scores = [float(getattr(scores, kind)) for scores in (judged.scores, known)]
    does = "predicted one step ahead" if kind == "prediction" else "simulated"
    fell = compared.estimate.search.value - result.estimate.search.value
    # Simulations with a root at the bound draw waves as long as a held-out block, and grow beyond;
    # outputs alone have none.
    at_bound = [model.estimate.at_stability_bound for model in (result, compared)]
    why = "worse by a tenth or two standard errors" if worse else ""
    if not worse and at_bound == [True, False] and "prediction" not in kinds[:1]:
        why = "with a root at the stability bound, unlike before"
    sentence = (
        f"The objective of {name} fell by {fell:.2g} in the search; held-out samples are {does}"
        f" with {scores[0]:.3g} % instead of {scores[1]:.3g} %"
        f"{f': {why}, so that the compared model is kept' if why else ''}."
    )
    alternatives = (Alternative(SEARCHED, scores[0]), Alternative(COMPARED, scores[1]))
    return Decision(SUBJECT, COMPARED if why else SEARCHED, alternatives, criterion, sentence)


def window_of(orders: Orders) -> ScoringWindow:
    """The chosen model counts every residual whose past is measured."""
    return ScoringWindow(orders.first_residual, orders.first_residual)


def _allowed(constraints: Constraints, orders: Orders, estimation: Recording) -> bool:
    """Whether a model of some orders may meet constraints."""
    try:
        check_constraints(constraints, orders, estimation.sampling_rate, estimation.input_names)
    except InputError:
        return False
    return True
