"""The search for the polynomial model of given orders, and estimates at the end of one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.pem.stretch_errors import StretchErrors
from evopem.estimation.polynomial_estimate import PolynomialEstimate, describe
from evopem.estimation.prediction_errors import (
    Errors,
    checked_errors,
    in_scaled_units,
    prediction_errors,
    scaled_errors,
)
from evopem.estimation.prediction_estimate import (
    EstimationTask,
    from_estimates,
    prediction_estimate,
    search_key,
)
from evopem.estimation.search.armax_problem import ArmaxProblem
from evopem.estimation.search.certificate import Target
from evopem.estimation.search.global_search import continued_search
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchResult, descended, pooled
from evopem.estimation.simulation_estimate import simulation_estimate
from evopem.models.constraint_checks import Focus, check_fit
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Recording

Array = NDArray[np.float64]


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
    log: Callable[[str], None] | None = None,
    target: Target | None = None,
) -> PolynomialEstimate:
    """Find the polynomial model of given orders with the smallest errors in focus, globally.

    ``data``: with one output.  One objective over all segments; each has an initial state of the
    plant and of the noise filter, and each recording a level where one is estimated.  ``settings``:
    objective, seed, bounds and size of the search.  Its draws come from
    ``SeedSequence(seed, spawn_key=(na, *nb, nc, nd, *nf, *nk, level))``, without nd, nf and level
    for ARMAX models of one input and segment, with the number of its restarts appended to the key
    when the search continues an earlier one.  Only the latter use ``initialization`` and
    ``n_initial_discard``: the first population of the others holds estimates of several kinds.
    ``window``: by default that of :func:`.default_window`, of each segment.  ``level``: whether a
    constant is estimated: ``A y = (B/F) u + (C/D) e + level``.  ``focus`` {"prediction",
    "simulation"}: errors of one step, of simulation, or of predictions that many samples ahead.
    ``earlier``: result of an earlier search of the same problem, to be combined with this one.
    ``optimum``: of one-step prediction without constraints, where these or a focus are given: to
    start from instead of searching it.  ``target``: what the search is made for: it ends once it is
    unlikely to get so low.  ``criteria`` and ``residuals`` are those of one step;
    ``focus_objective`` is that of the errors in focus.  The covariance is zero across active
    constraints, counts priors as observations, and allows for the colour of k-step and simulation
    errors by the noise model. It is None for these errors under the absolute objective.  Intervals
    near a bound that is not active do not know of it.  InputError when constraints contradict each
    other, the structure or the focus.  ValueError when the record is too short for the orders, or a
    setting is outside its range.
    """
    settings = settings or SearchSettings()
    # Output-error models of several inputs have more optima than 20,000 evaluations tell apart.
    many = settings.evaluations * max(data.inputs.shape[1], 1) ** 2
    settings = replace(settings, evaluations=many)
    rate, names = data.sampling_rate, data.input_names
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        errors = checked_errors(data, orders, settings, window, level)
        horizon = check_fit(focus, constraints, orders, rate, names)
        if constraints is None and focus == "prediction":
            found = _searched(errors, settings, earlier, log, target, rate)
        else:
            if earlier is not None:
                raise ValueError("an earlier search is not continued with a focus or constraints")
            given = constraints or Constraints()
            task = EstimationTask(errors, rate, settings, given, names, log, optimum)
            found = (
                simulation_estimate(task)
                if horizon is None
                else prediction_estimate(task, horizon)[0]
            )
    effect = found.constraints if constraints is not None else None
    model = replace(found.model, input_names=names, output_name=data.output_names[0])
    return replace(found, model=model, focus=focus, constraints=effect)


def _searched(
    errors: Errors,
    settings: SearchSettings,
    earlier: SearchResult | None,
    log: Callable[[str], None] | None,
    target: Target | None,
    sampling_rate: float,
) -> PolynomialEstimate:
    """The optimum of one-step prediction without constraints."""
    scaled, scales = scaled_errors(errors)
    problem = problem_of(scaled, settings.initialization)
    o, recombine = errors.orders, None
    if isinstance(problem, PolynomialProblem):
        recombine, key = problem.recombine, search_key(errors)
    else:
        key = (o.na, o.single.nb, o.nc, o.single.nk)
    if isinstance(problem, PolynomialProblem) and o.inputs > 1 and earlier is None:
        earlier = from_estimates(problem)
        earlier = earlier and replace(earlier, point=earlier.point * scales)
        if settings.evaluations == 0 and earlier is not None:
            return describe(errors, earlier, sampling_rate, shortest=True)
    found = continued_search(problem, scales, key, settings, earlier, log, recombine, target)
    del problem, scaled  # their tables are as large as those that follow
    return describe(errors, found, sampling_rate, shortest=True)


def problem_of(errors: Errors, initialization: str = "arx") -> ArmaxProblem | PolynomialProblem:
    """The search problem of prediction errors: that of the chapter for its ARMAX models.

    ``initialization``, "arx" or "incremental_order", is that of the latter.
    """
    of_armax = errors.orders.structure == "armax" and errors.orders.inputs == 1
    if of_armax and not errors.level and not isinstance(errors, StretchErrors):
        return ArmaxProblem(errors, initialization)
    return PolynomialProblem(errors)


def described(
    result: SearchResult,
    data: Recording,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool,
) -> PolynomialEstimate:
    """The full estimate at the end of a search, with residuals and covariance."""
    with one_blas_thread():
        errors = prediction_errors(data, orders, settings, window, level)
        return describe(errors, result, data.sampling_rate, shortest=True)


def descended_from(
    start: ArrayLike | PolynomialModel,
    earlier: SearchResult,
    data: Recording,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool,
) -> PolynomialEstimate:
    """The estimate after one descent, pooled with an earlier search of the problem.

    ``start`` (n,): A point in the problem's own units, or of several segments a model of smaller
    orders.
    """
    with one_blas_thread():
        errors = prediction_errors(data, orders, settings, window, level)
        scaled, scales = scaled_errors(errors)
        problem = problem_of(scaled)
        if not isinstance(start, PolynomialModel):
            point: Array | None = np.asarray(start) / scales
        elif isinstance(scaled, StretchErrors):
            models = [in_scaled_units(start, scaled, scales)]
            starts = PolynomialProblem(scaled, models, own_starts=False).starts()
            point = starts[0] if len(starts) else None
        else:
            raise TypeError("of one segment, start from a point")
        if point is None:
            return describe(errors, earlier, data.sampling_rate, shortest=True)
        ended = descended(problem, point)
        ended = replace(ended, point=ended.point * scales)
        return describe(errors, pooled(earlier, ended), data.sampling_rate, shortest=True)
