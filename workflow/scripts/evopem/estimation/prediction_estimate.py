"""Estimates for predictions one or more samples ahead, under constraints. The optimum without
constraints is the result where it meets them; else descents in coordinates that cannot leave the
region start from it, from linear estimates and from random points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from evopem.arrays import Array
from evopem.config.constraints import Constraints
from evopem.config.settings import SearchSettings
from evopem.errors import InputError, NoModelError
from evopem.estimation.pem.constrained_model import constrained_parameters, equalities
from evopem.estimation.pem.constrained_parameters import ConstrainedParameters
from evopem.estimation.pem.covariance import (
    Fitted,
    loss_deviation,
    of_coefficients,
    tangent_covariance,
    whitened_covariance,
)
from evopem.estimation.pem.derived_errors import CoordinateErrors, KStepErrors, Priors, priors_of
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import ConstraintEffect, PolynomialEstimate, describe
from evopem.estimation.prediction_errors import Units, in_scaled_units, scaled_errors
from evopem.estimation.search.blocks import searched_in_blocks
from evopem.estimation.search.certificate import Target
from evopem.estimation.search.global_search import FIRST_BATCH, FIRST_PASS, global_search
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import Log, SearchResult, descended, pooled
from evopem.estimation.search.staged_descent import LINEAR_STEPS, multistart, solve_linear
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_roots import roots

# Random starts of the descents under constraints and of k-step errors; where no search is asked
# for, those of its first pass.
RANDOM_STARTS = 36
ESTIMATES = 8  # estimates of a record with several inputs that a search begins with
DRAWS = 512  # random draws from which starts that meet fixed coefficients are taken
MEETS = 1e-9  # relative distance within which a point counts as one that meets the constraints


@dataclass(frozen=True)
class EstimationTask:
    """A record, orders and settings, checked."""

    errors: PolynomialErrors
    sampling_rate: float
    settings: SearchSettings
    constraints: Constraints
    names: Sequence[str] = ()  # of the inputs
    log: Log | None = None
    optimum: SearchResult | None = None  # of one-step prediction
    earlier: SearchResult | None = None  # an earlier search of it, to combine with this one
    target: Target | None = None

    @property
    def random_starts(self) -> int:
        """Random points from which descents under constraints and of other errors start."""
        return FIRST_BATCH if self.settings.evaluations == FIRST_PASS else RANDOM_STARTS

    def generator(self, *purpose: int) -> np.random.Generator:
        """Random draws of one purpose; without one those of the search of one-step prediction."""
        o = self.errors.orders
        nb, nf, nk = (orders or (0,) for orders in (o.nb, o.nf, o.nk))
        key = (o.na, *nb, o.nc, o.nd, *nf, *nk, int(self.errors.level), *purpose)
        return np.random.default_rng(np.random.SeedSequence(self.settings.seed, spawn_key=key))


def scaled_problem(errors: PolynomialErrors) -> tuple[PolynomialProblem, Units]:
    """The search problem of scaled signals, and its units."""
    scaled, units = scaled_errors(errors)
    return PolynomialProblem(scaled), units


def searched(task: EstimationTask, problem: PolynomialProblem, units: Units) -> SearchResult:
    """The optimum of one-step prediction, in the units of the signals: refined where it is known,
    else searched; of several inputs after the lowest optimum next to estimates."""
    if task.optimum is not None:
        # The search of ARMAX models counts other first residuals.
        ended = descended(problem, units.taken(task.optimum.point))
        diagnostics = task.optimum.diagnostics
        return replace(ended, point=units.restored(ended.point), diagnostics=diagnostics)
    known, search = None, partial(_searched_globally, task)
    if task.earlier is not None:
        known = units.taken(task.earlier.point), task.earlier.value
    result = searched_in_blocks(problem, search, known) or search(problem)
    result = replace(result, point=units.restored(result.point), ends=())
    return result if task.earlier is None else pooled(task.earlier, result)


def _searched_globally(
    task: EstimationTask, problem: PolynomialProblem, share: float = 1.0
) -> SearchResult:
    """The search of one problem; ``share``: of its objective in what the task knows of values."""
    known, earlier, target = None, task.earlier, task.target
    several = earlier is None and task.errors.orders.inputs > 1
    if several and len(starts := problem.starts()[:ESTIMATES]):
        known = multistart(problem.errors, starts, float(np.min(problem.values(starts))))
        if task.settings.evaluations == 0:
            return known
    lowest = known.value if known else share * earlier.value if earlier else np.inf
    target = target and target._replace(value=share * target.value)
    # An earlier search and this one draw independently.
    before = [d.diagnostics for d in (known or earlier,) if d is not None]
    generator = task.generator(*(d.n_restarts + d.descents for d in before))
    result = global_search(problem, task.settings, generator, task.log, lowest, target)
    return result if known is None else pooled(known, result)


def optimum_next_to(model: PolynomialModel, errors: PolynomialErrors) -> SearchResult | None:
    """Where a descent from a model, of these orders or smaller ones, ends, if it begins."""
    scaled, units = scaled_errors(errors)
    starts = PolynomialProblem(scaled, [in_scaled_units(model, units)], own_starts=False).starts()
    if not len(starts):
        return None
    ended = descended(PolynomialProblem(scaled), starts[0])
    return replace(ended, point=units.restored(ended.point))


def errors_ahead(errors: PolynomialErrors, horizon: int | None) -> PolynomialErrors | KStepErrors:
    """Errors of some samples ahead; of simulation, of points with C = A, where it is None."""
    return errors if horizon in (1, None) else KStepErrors(errors, horizon)


def without_plant_radius(errors: PolynomialErrors) -> PolynomialErrors:
    """The same problem where roots of A and F are held by the coordinates alone."""
    return errors.within_radius(UNBOUNDED_RADIUS, errors.noise_radius)


def coordinates_of(
    task: EstimationTask,
    errors: PolynomialErrors,
    constraints: Constraints,
    scales: Array | None = None,
    radius: float | None = None,
    levels: Sequence[float] | Array = (),
    tied: bool = False,
) -> tuple[ConstrainedParameters, Priors]:
    """Coordinates and priors of a problem; ``scales`` are the units of its points, ``levels`` and
    ``tied`` as of :func:`.constrained_parameters`."""
    o, rate = errors.orders, task.sampling_rate
    b_scales: Array | tuple[()] = ()
    if scales is not None:
        b_scales = np.array([scales[o.part("b", place)][0] for place in range(o.inputs)])
    rest = errors.dimension - o.parameters
    radius = errors.plant_radius if radius is None else radius
    parameters = constrained_parameters(
        constraints, o, rate, radius, task.names, b_scales, rest, levels, tied
    )
    return parameters, priors_of(constraints, parameters.parts, o, rate, b_scales)


def weight_of_priors(errors: PolynomialErrors, priors: Priors, residuals: Array) -> float:
    """What a squared deviation adds to the objective: as much as one more observation."""
    if not priors.terms:
        return 0.0
    deviation = loss_deviation(residuals, errors.dimension, errors.objective)
    if not np.isfinite(deviation):
        raise NoModelError("no weight of the priors is known: the residuals have no density at 0")
    added = deviation**2 if errors.objective == "quadratic" else 0.5 * deviation
    return errors.loss_factor * added


def prediction_estimate(
    task: EstimationTask, horizon: int | None
) -> tuple[PolynomialEstimate, Fitted]:
    """The estimate for errors of k steps, or of simulation, and what it was fitted by."""
    problem, units = scaled_problem(task.errors)
    scaled, scales = problem.errors, units.scales
    k_errors = errors_ahead(scaled, horizon)
    # Before the search, because it refuses constraints that no model meets.
    tied = horizon is None
    parameters, priors = coordinates_of(task, scaled, task.constraints, scales, tied=tied)
    free = _unconstrained(task, problem, horizon, units)
    weight = weight_of_priors(scaled, priors, k_errors.residuals(free.point))
    optimum, active, tangent = _constrained_optimum(
        *(task, problem, horizon, free, parameters, priors, weight)
    )
    prior_rows = priors.deviations(optimum.point)[1]
    fitted = Fitted(k_errors.jacobian(optimum.point), tangent, prior_rows, scaled.residual_counts())
    covariance = _covariance(scaled, horizon, optimum.point, fitted)
    objective, without = (
        scaled.loss(k_errors.residuals(point)) for point in (optimum.point, free.point)
    )
    unscaled = replace(optimum, point=units.restored(optimum.point))
    result = describe(task.errors, unscaled, task.sampling_rate)
    covariance = covariance and of_coefficients(covariance, task.errors.orders.parameters, scales)
    if optimum is free and not active and horizon == 1:
        covariance = result.model.covariance
    estimate = replace(
        result,
        model=replace(result.model, covariance=covariance),
        focus_objective=objective,
        constraints=ConstraintEffect(objective, without, (*equalities(task.constraints), *active)),
    )
    return estimate, fitted


def _constrained_optimum(
    task: EstimationTask,
    problem: PolynomialProblem,
    horizon: int | None,
    free: SearchResult,
    parameters: ConstrainedParameters,
    priors: Priors,
    weight: float,
) -> tuple[SearchResult, tuple[str, ...], Array]:
    """The optimum under constraints and priors, what is active there, and its free directions."""
    bounded = parameters.coordinates(free.point)
    nearest = parameters.point(bounded)[0]
    distance = float(np.max(np.abs(free.point - nearest), initial=0.0))
    near = distance <= MEETS * float(np.max(np.abs(free.point), initial=1.0))
    if not priors.terms and near and np.isfinite(parameters.barriers(bounded)[0]):
        return free, *parameters.active(parameters.unbounded(bounded, 0.0))
    wide = without_plant_radius(problem.errors)
    constrained = CoordinateErrors(errors_ahead(wide, horizon), parameters, priors, weight)
    starts = _starts(task, problem, constrained, parameters, priors, free.point)
    optimum = multistart(constrained, starts, max(free.value, 1e-300))
    z = parameters.snapped(optimum.point)
    if not constrained.values(z[None, :])[0] <= optimum.value * (1.0 + 1e-6):
        z = optimum.point
    point = parameters.point(parameters.bounded(z)[0])[0]
    return replace(optimum, point=point), *parameters.active(z)


def _unconstrained(
    task: EstimationTask, problem: PolynomialProblem, horizon: int | None, units: Units
) -> SearchResult:
    """The optimum without constraints, but with unstable plants where these are allowed."""
    optimum = searched(task, problem, units)
    optimum = replace(optimum, point=units.taken(optimum.point))
    stability, scaled = task.constraints.stability, problem.errors
    if horizon == 1 and stability == "required":
        return optimum
    free, tied = Constraints(stability=stability), horizon is None
    parameters, priors = coordinates_of(task, scaled, free, units.scales, tied=tied)
    wide = without_plant_radius(scaled)
    constrained = CoordinateErrors(errors_ahead(wide, horizon), parameters, priors)
    random = problem.spread(task.random_starts, task.generator(0, 1))[0]
    starts = np.concatenate([optimum.point[None, :], problem.estimates[0], random])
    if stability == "free":
        # The ARX model of least squares, its poles wherever they are.
        linear, steps = ~wide.linear("c", "d", "f", "plant"), LINEAR_STEPS[wide.objective]
        arx = solve_linear(wide, np.zeros((1, wide.dimension)), linear, steps)
        starts = np.concatenate([starts, arx])
    z = np.array([parameters.unbounded(parameters.coordinates(point)) for point in starts])
    optimum = multistart(constrained, z, optimum.value)
    return replace(optimum, point=constrained.points(optimum.point[None, :])[0])


def _starts(
    task: EstimationTask,
    problem: PolynomialProblem,
    constrained: CoordinateErrors,
    parameters: ConstrainedParameters,
    priors: Priors,
    free: Array,
) -> Array:
    """Coordinates from which descents under constraints start, (M, k)."""
    generator = task.generator(0, 2)
    points = np.concatenate([free[None, :], problem.estimates[0]])
    points = np.concatenate([points, _with_expected_modes(points[0], priors)])
    z = [parameters.unbounded(parameters.coordinates(point)) for point in points]
    z += [
        parameters.random(parameters.coordinates(point), generator)
        for point in problem.spread(task.random_starts, generator)[0]
    ]
    starts = np.array(z)
    if not np.isfinite(constrained.values(starts)).any():
        # Fixed coefficients leave a small region: draw until some models lie in it.
        drawn = problem.spread(DRAWS, generator)[0]
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
    for term, _ in priors.terms:
        if term.quantity not in ("frequency", "damping"):
            continue
        for part in priors.denominators:
            poles = list(roots(point[part]))
            if len(poles) < 2:
                continue
            frequency = term.mean if term.quantity == "frequency" else term.mode_hz or 0.0
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


def _covariance(
    errors: PolynomialErrors, horizon: int | None, point: Array, fitted: Fitted
) -> ParameterCovariance | None:
    if horizon is None or (horizon > 1 and errors.objective == "absolute"):
        return None
    o, innovations = errors.orders, errors.residuals(point)
    if horizon == 1 and o.na + o.noise_states == 0:
        # Nothing whitens the errors of a model of the plant alone.
        return whitened_covariance(fitted, innovations, errors.objective)
    deviation = loss_deviation(innovations, fitted.tangent.shape[1], errors.objective)
    if not np.isfinite(deviation):
        return None
    weights = np.ones(1) if horizon == 1 else KStepErrors(errors, horizon).weights(point)
    return tangent_covariance(fitted, (weights, np.ones(1)), deviation)
