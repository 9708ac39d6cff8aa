"""Estimates for predictions one or more samples ahead, under constraints.

The optimum without constraints is searched first.  Where it meets them it is the result;
elsewhere descents start from it, from the linear estimates of the search and from random points,
each moved into the region, in coordinates that cannot leave the region.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.constraints import Constraints
from evopem.errors import InputError
from evopem.estimation.constrained_model import constrained_parameters, equalities, priors_of
from evopem.estimation.estimation_task import (
    EstimationTask,
    coefficient_covariance,
    errors_ahead,
    objective_of,
    prior_weight_of,
    scored_residuals,
    with_plant_radius,
)
from evopem.estimation.pem.constrained_parameters import ConstrainedParameters
from evopem.estimation.pem.focus_covariance import (
    Fitted,
    loss_deviation,
    tangent_covariance,
)
from evopem.estimation.pem.k_step_errors import KStepErrors
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.pem.priors import Priors
from evopem.estimation.polynomial_estimate import (
    ConstraintEffect,
    PolynomialEstimate,
    describe,
)
from evopem.estimation.polynomial_search import scaled_errors
from evopem.estimation.search.constrained_errors import ConstrainedErrors
from evopem.estimation.search.global_search import global_search
from evopem.estimation.search.linear_completion import LINEAR_STEPS, solve_linear
from evopem.estimation.search.multistart import multistart
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchResult, descended
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomials import roots

Array = NDArray[np.float64]

# Random starts of the descents under constraints and of k-step errors.
RANDOM_STARTS = 24
# Random draws from which starts that meet fixed coefficients are taken.
DRAWS = 512
# Relative distance within which a point counts as one that meets the constraints.
MEETS = 1e-9


def prediction_estimate(task: EstimationTask, horizon: int) -> tuple[PolynomialEstimate, Fitted]:
    """The estimate for errors of k steps, and what its covariance follows from."""
    scaled, scales = scaled_errors(task.errors)
    problem = PolynomialProblem(scaled)
    b_scale = float(scales[scaled.parts()["b"]][0]) if task.orders.single.nb else 1.0
    k_errors = errors_ahead(scaled, horizon)
    # Before the search, because it refuses constraints that no model meets.
    parameters = constrained_parameters(
        task.constraints,
        task.orders,
        scaled.level,
        task.sampling_rate,
        scaled.plant_radius,
        b_scale,
    )
    priors = priors_of(task.constraints, parameters, task.orders, task.sampling_rate, b_scale)
    free = _unconstrained(task, problem, horizon, b_scale, scales)
    k_residuals = scored_residuals(k_errors, free.point)
    deviation = loss_deviation(k_residuals, scaled.dimension, scaled.objective)
    if priors.terms and not np.isfinite(deviation):
        raise ValueError(
            "the weight of the priors is not known: the residuals have no density at 0"
        )
    weight = prior_weight_of(scaled, deviation) if priors.terms else 0.0
    found, active, tangent = _constrained_optimum(
        *(task, problem, horizon, free, parameters, priors, weight)
    )
    prior_rows = priors.deviations(found.point)[1]
    covariance = _covariance(scaled, k_errors, found.point, tangent, prior_rows, horizon)
    objective, without = (
        objective_of(scaled, scored_residuals(k_errors, point))
        for point in (found.point, free.point)
    )
    unscaled = replace(found, point=found.point * scales)
    result = describe(task.errors, unscaled, task.sampling_rate)
    coefficients = task.orders.parameters
    covariance = covariance and coefficient_covariance(covariance, scales, coefficients)
    if found is free and not active and horizon == 1:
        covariance = result.model.covariance
    estimate = replace(
        result,
        model=replace(result.model, covariance=covariance),
        focus_objective=objective,
        constraints=ConstraintEffect(objective, without, (*equalities(task.constraints), *active)),
    )
    return estimate, Fitted(k_errors.jacobian(found.point), tangent, prior_rows)


def _constrained_optimum(
    task: EstimationTask,
    problem: PolynomialProblem,
    horizon: int,
    free: SearchResult,
    parameters: ConstrainedParameters,
    priors: Priors,
    weight: float,
) -> tuple[SearchResult, tuple[str, ...], Array]:
    """The optimum under constraints and priors, what is active there, and its free directions.

    The unconstrained optimum itself where it meets all constraints and there are no priors.
    """
    bounded = parameters.coordinates(free.point)
    nearest = parameters.point(bounded)[0]
    if not priors.terms and _meets(parameters, bounded, free.point, nearest):
        return free, *parameters.active(parameters.unbounded(bounded, 0.0))
    wide = with_plant_radius(problem.errors, UNBOUNDED_RADIUS)
    constrained = ConstrainedErrors(errors_ahead(wide, horizon), parameters, priors, weight)
    starts = _starts(task, problem, constrained, free.point)
    found = multistart(constrained, starts, max(free.value, 1e-300))
    z = parameters.snapped(found.point)
    if not constrained.values(z[None, :])[0] <= found.value * (1.0 + 1e-6):
        z = found.point
    point = parameters.point(parameters.bounded(z)[0])[0]
    return replace(found, point=point), *parameters.active(z)


def _unconstrained(
    task: EstimationTask, problem: PolynomialProblem, horizon: int, b_scale: float, scales: Array
) -> SearchResult:
    """The optimum without constraints, but with unstable plants where these are allowed."""
    found = _one_step_optimum(task, problem, scales)
    if horizon == 1 and task.constraints.stability == "required":
        return found
    scaled = problem.errors
    k_errors = errors_ahead(scaled, horizon)
    starts = np.concatenate(
        [
            found.point[None, :],
            problem.estimates(),
            problem.random(RANDOM_STARTS, task.generator(1)),
        ]
    )
    if task.constraints.stability == "required":
        # k-step errors are not linear in the states and B alone: descents follow at once.
        return multistart(k_errors, scaled.repair(starts), found.value)
    alone = Constraints(stability="free")
    parameters = constrained_parameters(
        alone, task.orders, scaled.level, task.sampling_rate, scaled.plant_radius, b_scale
    )
    wide = with_plant_radius(scaled, UNBOUNDED_RADIUS)
    constrained = ConstrainedErrors(
        errors_ahead(wide, horizon),
        parameters,
        Priors((), parameters.parts, task.sampling_rate),
        0.0,
    )
    starts = np.concatenate([starts, _least_squares_start(wide)])
    z = np.array([parameters.unbounded(parameters.coordinates(point)) for point in starts])
    found = multistart(constrained, z, found.value)
    return replace(found, point=constrained.points(found.point[None, :])[0])


def _one_step_optimum(
    task: EstimationTask, problem: PolynomialProblem, scales: Array
) -> SearchResult:
    """The optimum of one-step prediction: searched, or refined where it is known."""
    if task.optimum is None:
        return global_search(
            problem, task.settings, task.generator(0), task.log, recombine=problem.recombine
        )
    # The search of ARMAX models counts other first residuals.
    ended = descended(problem, task.optimum.point / scales)
    return replace(ended, diagnostics=task.optimum.diagnostics)


def _least_squares_start(errors: PolynomialErrors) -> Array:
    """The ARX model of least squares, its poles wherever they are, (1, n)."""
    point = np.zeros((1, errors.dimension))
    linear = np.ones(errors.dimension, dtype=bool)
    for name in ("c", "d", "f", "plant"):
        linear[errors.parts()[name]] = False
    return solve_linear(errors, point, linear, LINEAR_STEPS[errors.objective])


def _starts(
    task: EstimationTask, problem: PolynomialProblem, constrained: ConstrainedErrors, free: Array
) -> Array:
    """Coordinates from which descents under constraints start, (M, k)."""
    parameters, generator = constrained.parameters, task.generator(2)
    points = np.concatenate([free[None, :], problem.estimates()])
    points = np.concatenate([points, _with_expected_modes(points[0], constrained.priors)])
    z = [parameters.unbounded(parameters.coordinates(point)) for point in points]
    z += [
        parameters.random(parameters.coordinates(point), generator)
        for point in problem.random(RANDOM_STARTS, generator)
    ]
    starts = np.array(z)
    if not np.isfinite(constrained.values(starts)).any():
        # Fixed coefficients leave a small region: draw until some models lie in it.
        drawn = problem.random(DRAWS, generator)
        more = np.array([parameters.unbounded(parameters.coordinates(point)) for point in drawn])
        starts = np.concatenate([starts, more[np.isfinite(constrained.values(more))]])
    starts = starts[np.isfinite(constrained.values(starts))]
    if not len(starts):
        raise InputError(
            "constraints",
            f"none of {DRAWS} random models with the fixed coefficients is stable and invertible",
            "check the fixed coefficients, or set stability to free",
            "fixed_coefficients",
        )
    completed = starts.copy()
    completed[:, parameters.linear] = 0.0
    completed = solve_linear(
        constrained, completed, parameters.linear, LINEAR_STEPS[constrained.objective]
    )
    better = constrained.values(completed) <= constrained.values(starts)
    return np.where(better[:, None], completed, starts)


def _with_expected_modes(point: Array, priors: Priors) -> Array:
    """The point with its mode nearest to each expected one moved there, (m, n)."""
    moved = []
    for term in priors.terms:
        if term.quantity not in ("frequency", "damping"):
            continue
        for name in "af":
            part = priors.parts[name]
            poles = list(roots(point[part]))
            if len(poles) < 2:
                continue
            frequency = term.mean if term.quantity == "frequency" else term.mode_hz
            damping = term.mean if term.quantity == "damping" else 0.05
            turn = 2.0 * np.pi * frequency / priors.sampling_rate
            pole = np.exp(turn * (-damping + 1j * np.sqrt(max(1.0 - damping**2, 0.0))))
            upper = sorted((z for z in poles if z.imag > 0.0), key=lambda z: abs(z - pole))
            real = [z for z in poles if z.imag == 0.0]
            gone = [upper[0], upper[0].conjugate()] if upper else real[:2]
            left = list(poles)
            for z in gone:
                left.pop(int(np.argmin(np.abs(np.array(left) - z))))
            changed = point.copy()
            changed[part] = np.real(np.poly([*left, pole, pole.conjugate()]))[1:]
            moved.append(changed)
    return np.array(moved).reshape(len(moved), len(point))


def _meets(parameters: ConstrainedParameters, bounded: Array, point: Array, nearest: Array) -> bool:
    barrier, _, _ = parameters.barriers(bounded)
    distance = float(np.max(np.abs(point - nearest), initial=0.0))
    return np.isfinite(barrier) and distance <= MEETS * float(np.max(np.abs(point), initial=1.0))


def _covariance(
    errors: PolynomialErrors,
    k_errors: PolynomialErrors | KStepErrors,
    point: Array,
    tangent: Array,
    prior_rows: Array,
    horizon: int,
) -> ParameterCovariance | None:
    if horizon > 1 and errors.objective == "absolute":
        return None
    innovations = errors.residuals(point)[errors.loss_start :]
    deviation = loss_deviation(innovations, tangent.shape[1], errors.objective)
    if not np.isfinite(deviation):
        return None
    weights = k_errors.weights(point) if isinstance(k_errors, KStepErrors) else np.ones(1)
    return tangent_covariance(
        k_errors.jacobian(point), tangent, prior_rows, (weights, np.ones(1)), deviation
    )
