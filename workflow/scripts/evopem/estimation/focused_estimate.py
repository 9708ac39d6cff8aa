"""Estimates for k-step prediction or for simulation, and estimates under constraints."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.errors import InputError
from evopem.estimation.constrained_model import constrained_parameters, equalities, priors_of
from evopem.estimation.estimation_task import (
    EstimationTask,
    coefficient_covariance,
    prior_weight_of,
    with_plant_radius,
)
from evopem.estimation.pem.focus_covariance import (
    Fitted,
    loss_deviation,
    two_stage_covariance,
)
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.polynomial_estimate import PolynomialEstimate, describe
from evopem.estimation.polynomial_search import checked_errors, scaled_errors
from evopem.estimation.prediction_estimate import prediction_estimate
from evopem.estimation.search.constrained_errors import ConstrainedErrors
from evopem.estimation.search.linear_completion import LINEAR_STEPS, solve_linear
from evopem.estimation.search.multistart import multistart
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.estimation.search.starting_polynomials import noise_model
from evopem.models.constraint_checks import Focus, check_fit
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomials import roots
from evopem.models.structures import Orders
from evopem.signals.recording import Recording

# Random starts of the noise model.
RANDOM_STARTS = 24
# Ways to divide the plant's poles between A and F of which the noise model is refined.
REFINED_DIVISIONS = 3


def simulation_estimate(task: EstimationTask) -> PolynomialEstimate:
    """The estimate for simulation errors: output error, then the noise model given the plant."""
    o, errors = task.orders, task.errors
    of_plant, of_noise = _divided_constraints(task.constraints, o)
    plant_orders = Orders(nb=o.single.nb, nf=o.na + o.single.nf, nk=o.single.nk)
    plant_task = replace(
        task,
        errors=errors.of_orders(plant_orders),
        structure="oe",
        constraints=of_plant,
        optimum=None,
    )
    plant, fit = prediction_estimate(plant_task, 1)
    scaled, scales = scaled_errors(errors)
    problem = PolynomialProblem(scaled)
    fitted = [
        (_noise_start(problem, scales, plant, a, f), a, f)
        for a, f in _divisions(plant.model.f, o, of_plant, task.sampling_rate)
    ]
    values = [float(problem.values(point[None, :])[0]) for point, _, _ in fitted]
    best: SearchResult | None = None
    for row in np.argsort(values, kind="stable")[:REFINED_DIVISIONS]:
        point, a, f = fitted[int(row)]
        found = _noise_fit(task, problem, of_noise, point)
        if best is None or found.value < best.value:
            best, division = found, (a, f)
    assert best is not None
    unscaled = replace(plant.search, point=best.point * scales, value=plant.search.value)
    result = describe(errors, unscaled, task.sampling_rate)
    covariance = _simulation_covariance(task, problem.errors, best.point, fit, scales, *division)
    effect = plant.constraints
    if effect is not None:
        effect = replace(effect, active=(*effect.active, *equalities(of_noise)))
    return replace(
        result,
        model=replace(result.model, covariance=covariance),
        focus_objective=plant.focus_objective,
        constraints=effect,
    )


def _divided_constraints(
    constraints: Constraints, orders: Orders
) -> tuple[Constraints, Constraints]:
    """Constraints of the output-error model ``B / F``, F being A F, and those of C and D."""
    of_noise = {k: v for k, v in constraints.fixed_coefficients.items() if k[0] in "cd"}
    of_plant = {k: v for k, v in constraints.fixed_coefficients.items() if k[0] in "abf"}
    noise_priors = tuple(
        p for p in constraints.priors if p.quantity[0] in "cd" and p.quantity[1:].isdecimal()
    )
    plant_priors = tuple(p for p in constraints.priors if p not in noise_priors)
    if orders.na:
        of_plant = {f"f{k[1:]}" if k[0] == "a" else k: v for k, v in of_plant.items()}
        plant_priors = tuple(
            replace(p, quantity=f"f{p.quantity[1:]}")
            if p.quantity[0] == "a" and p.quantity[1:].isdecimal()
            else p
            for p in plant_priors
        )
    plant = replace(constraints, fixed_coefficients=of_plant, priors=plant_priors)
    return plant, Constraints(fixed_coefficients=of_noise, priors=noise_priors)


def _divisions(
    denominator: Array, orders: Orders, constraints: Constraints, sampling_rate: float
) -> Iterator[tuple[Array, Array]]:
    """The ways to divide the plant's denominator into A and F with real coefficients."""
    one = np.ones(1)
    if orders.single.nf == 0 or orders.na == 0:
        yield (denominator, one) if orders.na else (one, denominator)
        return
    poles = roots(denominator[1:])
    units = [np.array([z, z.conjugate()]) for z in poles if z.imag > 0.0]
    units += [np.array([z]) for z in poles if z.imag == 0.0]
    fixed = constrained_parameters(
        constraints, Orders(nb=1, nf=orders.na + orders.single.nf), False, sampling_rate, 1.0
    ).polynomials["f"]
    known = roots(getattr(fixed, "factor", one)[1:])
    held = [
        k for k, unit in enumerate(units) if any(np.min(np.abs(unit - z)) < 1e-6 for z in known)
    ]
    others = [k for k in range(len(units)) if k not in held]
    none = True
    for count in range(len(others) + 1):
        for chosen in combinations(others, count):
            if sum(len(units[k]) for k in chosen) == orders.na:
                none = False
                of_a = np.concatenate([units[k] for k in chosen])
                of_f = np.concatenate(
                    [units[k] for k in range(len(units)) if k not in chosen] or [np.empty(0)]
                )
                yield np.real(np.poly(of_a)), np.real(np.poly(of_f))
    if none:
        raise InputError(
            "structure",
            f"the poles of the plant that simulates best cannot be divided into na = {orders.na} "
            f"and nf = {orders.single.nf} with real coefficients",
            "use even na and nf, or a structure with one of the two",
        )


def _noise_start(
    problem: PolynomialProblem, scales: Array, plant: PolynomialEstimate, a: Array, f: Array
) -> Array:
    """A scaled point with a plant, and C and D by Hannan & Rissanen (1982)."""
    errors, model = problem.errors, plant.model
    parts, point = errors.parts(), np.zeros(errors.dimension)
    point[parts["a"]], point[parts["f"]] = a[1:], f[1:]
    point[parts["b"]] = model.b / scales[parts["b"]]
    point[parts["level"]] = model.level * float(np.sum(a)) / scales[parts["level"]]
    states = np.zeros(errors.dimension, dtype=bool)
    states[parts["plant"]] = states[parts["noise"]] = True
    if states.any():
        point = solve_linear(errors, point[None, :], states, LINEAR_STEPS[errors.objective])[0]
    o = errors.orders
    if o.nc or o.nd:
        residuals = errors.residuals(point)[errors.loss_start :]
        point[parts["c"]], point[parts["d"]] = noise_model(residuals, o.nc, o.nd)
    held = point.copy()
    point = errors.repair(point[None, :])[0]
    # Fixed poles may lie outside the region: only C and D are moved inside.
    for name in "af":
        point[parts[name]] = held[parts[name]]
    return point


def _noise_fit(
    task: EstimationTask, problem: PolynomialProblem, of_noise: Constraints, point: Array
) -> SearchResult:
    """C and D with the smallest one-step errors, the plant and the level held."""
    errors = with_plant_radius(problem.errors, UNBOUNDED_RADIUS)
    parts = errors.parts()
    held = {
        f"{name}{index + (name != 'b')}": float(value)
        for name in "abf"
        for index, value in enumerate(point[parts[name]])
    }
    fixed = replace(of_noise, fixed_coefficients={**held, **of_noise.fixed_coefficients})
    level_value = float(point[parts["level"]][0]) if errors.level else None
    parameters = constrained_parameters(
        fixed, task.orders, errors.level, task.sampling_rate, UNBOUNDED_RADIUS, 1.0, level_value
    )
    priors = priors_of(of_noise, parameters, task.orders, task.sampling_rate)
    residuals = errors.residuals(point)[errors.loss_start :]
    deviation = loss_deviation(residuals, errors.dimension, errors.objective)
    weight = prior_weight_of(errors, deviation) if priors.terms else 0.0
    constrained = ConstrainedErrors(errors, parameters, priors, weight)
    white = point.copy()
    white[parts["c"]] = white[parts["d"]] = 0.0
    random = problem.random(RANDOM_STARTS, task.generator(3))
    starts = np.array([parameters.coordinates(each) for each in (point, white, *random)])
    starts[:, parameters.linear] = 0.0
    starts = starts[np.isfinite(constrained.values(starts))]
    if not len(starts):
        raise InputError(
            "constraints",
            "no invertible noise model with the fixed coefficients was found",
            "check the fixed coefficients of C and D",
            "fixed_coefficients",
        )
    if parameters.linear.any():
        steps = LINEAR_STEPS[errors.objective]
        starts = solve_linear(constrained, starts, parameters.linear, steps)
    if not len(parameters.codes):
        # A noise model without coefficients or states.
        value = float(errors.values(point[None, :])[0])
        return SearchResult(point, value, SearchDiagnostics.none())
    largest = float(np.min(constrained.values(starts)))
    found = multistart(constrained, starts, largest)
    return replace(found, point=constrained.points(found.point[None, :])[0])


def _simulation_covariance(
    task: EstimationTask,
    errors: PolynomialErrors,
    point: Array,
    fit: Fitted,
    scales: Array,
    a: Array,
    f: Array,
) -> ParameterCovariance | None:
    """Of the plant from coloured simulation errors, and of C and D fitted given the plant."""
    from scipy.linalg import block_diag

    o, parts = task.orders, errors.parts()
    if errors.objective == "absolute":
        return None
    of_noise = _divided_constraints(task.constraints, o)[1]
    parameters = constrained_parameters(
        of_noise, o, errors.level, task.sampling_rate, UNBOUNDED_RADIUS
    )
    priors = priors_of(of_noise, parameters, o, task.sampling_rate)
    jacobian = errors.jacobian(point)
    innovations = errors.residuals(point)[errors.loss_start :]
    deviation = loss_deviation(innovations, errors.dimension, errors.objective)
    c, d = (np.concatenate([[1.0], point[parts[name]]]) for name in "cd")
    columns = np.r_[parts["c"], parts["d"], parts["plant"], parts["noise"]]
    held = np.r_[parts["a"], parts["b"], parts["f"], parts["level"]]
    # C and D are linear in their coordinates, wherever these are.
    none = np.zeros(len(parameters.codes))
    bases = [
        parameters.polynomials[name].part(none[parameters.own[name]]).derivatives for name in "cd"
    ]
    second = Fitted(
        jacobian[:, columns],
        block_diag(*bases, np.eye(o.single.nf + o.noise_states)),
        priors.deviations(point)[1][:, columns],
    )
    to_second = _to_held(o, a, f, float(point[parts["level"]].sum()), fit.jacobian.shape[1])
    covariance = two_stage_covariance(
        fit, second, (c, np.convolve(a, d)), to_second, jacobian[:, held], deviation
    )
    before_f, level = o.na + o.single.nb, int(errors.level)
    of_f = before_f + np.arange(o.single.nf)
    of_c_and_d = len(held) + np.arange(o.nc + o.nd)
    order = np.r_[np.arange(before_f), of_c_and_d, of_f]
    assert len(held) == before_f + o.single.nf + level
    return coefficient_covariance(
        ParameterCovariance(covariance.factor[order], covariance.null_space[order]),
        scales,
        len(order),
    )


def _to_held(orders: Orders, a: Array, f: Array, level: float, size: int) -> Array:
    """Derivatives of [a, b, f, level] by the point [b, A F, level, state] of output error."""
    na, nf, nb = orders.na, orders.single.nf, orders.single.nb
    product = np.zeros((na + nf, na + nf))
    # d(A F) = F dA + A dF.
    for j in range(na):
        product[j : j + nf + 1, j] = f
    for j in range(nf):
        product[j : j + na + 1, na + j] = a
    divided = np.linalg.pinv(product) if na + nf else product
    with_level = int(size > nb + 2 * (na + nf))
    derivatives = np.zeros((na + nb + nf + with_level, size))
    of_product = slice(nb, nb + na + nf)
    derivatives[:na, of_product] = divided[:na]
    derivatives[na : na + nb, :nb] = np.eye(nb)
    derivatives[na + nb : na + nb + nf, of_product] = divided[na:]
    if with_level:
        # The level of the equation is A(1) times that of the output.
        at_one = float(np.sum(a))
        derivatives[-1, nb + na + nf] = at_one
        derivatives[-1] += level / at_one * derivatives[:na].sum(axis=0)
    return derivatives


Array = NDArray[np.float64]
Log = Callable[[str], None]


def estimate_focused(
    data: Recording,
    orders: Orders,
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

    Parameters are those of :func:`.polynomial_search.estimate_polynomial`, and:

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
        As :func:`.polynomial_search.estimate_polynomial`.
    """
    settings = settings or SearchSettings()
    errors = checked_errors(data, orders, settings, window, level)
    if not isinstance(errors, PolynomialErrors):
        raise ValueError("a focus and constraints are those of one recording")
    horizon = check_fit(focus, constraints, orders, data.sampling_rate)
    known = constraints or Constraints()
    structure = orders.structure
    task = EstimationTask(errors, structure, data.sampling_rate, settings, known, log, optimum)
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        found = (
            simulation_estimate(task) if horizon is None else prediction_estimate(task, horizon)[0]
        )
    effect = found.constraints if constraints is not None else None
    return replace(found, focus=focus, constraints=effect)
