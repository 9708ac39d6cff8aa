"""The global search of one polynomial model: of given orders, with a focus and constraints."""

from dataclasses import replace

from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.config.structures import REGULARISED
from evopem.estimation.impulse_response import estimate_response
from evopem.estimation.polynomial_estimate import PolynomialEstimate, describe
from evopem.estimation.prediction_errors import checked_errors
from evopem.estimation.prediction_estimate import (
    EstimationTask,
    prediction_estimate,
    scaled_problem,
    searched,
)
from evopem.estimation.search.certificate import Target
from evopem.estimation.search.problem import Log, SearchResult
from evopem.estimation.simulation_estimate import simulation_estimate
from evopem.models.constraint_checks import Focus, check_fit
from evopem.models.orders import Orders
from evopem.models.polynomial import of_signals
from evopem.signals.recording import Recording


def estimate_polynomial(
    data: Recording,
    orders: Orders,
    *,
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    focus: Focus = "prediction",
    constraints: Constraints | None = None,
    earlier: SearchResult | None = None,
    optimum: SearchResult | None = None,
    log: Log | None = None,
    target: Target | None = None,
) -> PolynomialEstimate:
    """Find the polynomial model of given orders with the smallest errors in focus, globally. One
    objective over all segments, each with initial states, and each recording with a level where one
    is estimated: ``A y = (B/F) u + (C/D) e + level``. Draws come from ``SeedSequence(seed,
    spawn_key=(na, *nb, nc, nd, *nf, *nk, level))``. ARMAX models of one input and segment without a
    level alone use ``n_initial_discard``. ``earlier``: a search of the same problem to combine with
    this one. ``optimum``: of one-step prediction without constraints, where these or a focus are
    given. ``target``: what the search is made for; it ends once it is unlikely to get so low.
    Criteria and residuals are those of one step. The covariance is zero across active constraints,
    counts priors as observations, and is None for absolute errors of several steps. InputError when
    constraints contradict each other, the structure or the focus; ValueError when the record is too
    short, or a setting is outside its range."""
    settings = settings or SearchSettings()
    # Output-error models of several inputs have more optima than 20,000 evaluations tell apart.
    many = settings.evaluations * max(data.inputs.shape[1], 1) ** 2
    settings = replace(settings, evaluations=many)
    rate, names = data.sampling_rate, data.input_names
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        errors = checked_errors(data, orders, settings, window, level)
        horizon = check_fit(focus, constraints, orders, rate, names)
        plain = constraints is None and focus == "prediction"
        given = settings, constraints or Constraints(), names
        task = EstimationTask(errors, rate, *given, log, optimum, earlier, target)
        if orders.structure in REGULARISED:
            fitted = estimate_response(errors, rate)
        elif plain:
            result = searched(task, *scaled_problem(errors))
            fitted = describe(errors, result, rate, shortest=True)
        elif earlier is not None:
            raise ValueError("an earlier search is not continued with a focus or constraints")
        elif horizon is None:
            fitted = simulation_estimate(task)
        else:
            fitted = prediction_estimate(task, horizon)[0]
    effect = fitted.constraints if constraints is not None else None
    return replace(fitted, model=of_signals(fitted.model, data), focus=focus, constraints=effect)
