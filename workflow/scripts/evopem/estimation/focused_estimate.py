"""Estimates for k-step prediction or for simulation, and estimates under constraints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.estimation_task import EstimationTask
from evopem.estimation.polynomial_estimate import PolynomialEstimate, checked_errors
from evopem.estimation.prediction_estimate import prediction_estimate
from evopem.estimation.search.problem import SearchResult
from evopem.estimation.simulation_estimate import simulation_estimate
from evopem.models.constraint_checks import Focus, check_fit
from evopem.models.structures import Orders, orders_of

Array = NDArray[np.float64]
Log = Callable[[str], None]


def estimate_focused(
    input: ArrayLike | None,  # noqa: A002 - the field's word
    output: ArrayLike,
    structure: str,
    orders: Orders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    focus: Focus = "prediction",
    constraints: Constraints | None = None,
    optimum: SearchResult | None = None,
    log: Log | None = None,
) -> PolynomialEstimate:
    """Find the polynomial model with the smallest errors in focus that meets constraints.

    Parameters are those of :func:`.polynomial_estimate.estimate_polynomial`, and:

    Parameters
    ----------
    focus : {"prediction", "simulation"} or int
        Errors of one step, of simulation, or of predictions that many samples ahead.
    constraints : Constraints, optional
    optimum : SearchResult, optional
        Of one-step prediction without constraints, to start from instead of searching it.

    Returns
    -------
    PolynomialEstimate
        ``criteria`` and ``residuals`` are those of one step; ``focus_objective`` is that of the
        errors in focus.  The covariance is zero across active constraints, counts priors as
        observations, and allows for the colour of k-step and simulation errors by the noise model
        (:func:`.focus_covariance.tangent_covariance`,
        :func:`.focus_covariance.two_stage_covariance`).
        It is None for these errors under the absolute objective.
        Intervals near a bound that is not active do not know of it.

    Raises
    ------
    InputError
        When constraints contradict each other, the structure or the focus.
    ValueError
        As :func:`.polynomial_estimate.estimate_polynomial`.
    """
    o = orders_of(structure, orders)
    settings = settings or SearchSettings()
    errors = checked_errors(input, output, o, settings, window, level)
    horizon = check_fit(focus, constraints, o, sampling_rate)
    known = constraints or Constraints()
    task = EstimationTask(errors, structure, sampling_rate, settings, known, log, optimum)
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        found = (
            simulation_estimate(task) if horizon is None else prediction_estimate(task, horizon)[0]
        )
    effect = found.constraints if constraints is not None else None
    return replace(found, focus=focus, constraints=effect)
