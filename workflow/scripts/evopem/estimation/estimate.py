"""The estimate of one polynomial model: of given orders, with a focus and constraints.

For errors of simulation the plant comes first, then the noise model given the plant.  C and D
follow by one-step errors, for each way to divide the poles of the plant between A and F.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, combinations

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array, one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.config.structures import REGULARISED
from evopem.errors import InputError
from evopem.estimation.impulse_response import estimate_response
from evopem.estimation.pem.constrained_model import equalities, plant_polynomial
from evopem.estimation.pem.constrained_parameters import ConstrainedParameters
from evopem.estimation.pem.constrained_polynomials import Linear
from evopem.estimation.pem.covariance import (
    Fitted,
    loss_deviation,
    of_coefficients,
    two_stage_covariance,
)
from evopem.estimation.pem.derived_errors import CoordinateErrors
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.polynomial_estimate import PolynomialEstimate, describe
from evopem.estimation.prediction_errors import Units, checked_errors
from evopem.estimation.prediction_estimate import (
    EstimationTask,
    coordinates_of,
    prediction_estimate,
    scaled_problem,
    searched,
    weight_of_priors,
    without_plant_radius,
)
from evopem.estimation.search.certificate import Target
from evopem.estimation.search.linear_estimates import noise_model
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import Log, SearchDiagnostics, SearchResult
from evopem.estimation.search.staged_descent import LINEAR_STEPS, multistart, solve_linear
from evopem.models.constraint_checks import Focus, check_fit
from evopem.models.orders import Orders
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel, of_signals
from evopem.models.polynomial_roots import roots
from evopem.signals.recording import Recording

Plant = tuple[Array, tuple[Array, ...]]  # A and all F_i, their leading 1 included

# Ways to divide the plant's poles between A and F of which the noise model is refined.
REFINED_DIVISIONS = 3


def simulation_estimate(task: EstimationTask) -> PolynomialEstimate:
    """The estimate for simulation errors: output error, then the noise model given the plant."""
    o, shared = task.errors.orders, _has_shared_poles(task.errors.orders)
    of_plant, of_noise = _divided_constraints(task.constraints, o)
    if shared:
        plant_orders = Orders(na=o.na, nb=o.nb, nc=o.na, nf=o.nf, nk=o.nk)
    else:
        plant_orders = Orders(nb=o.nb, nf=tuple(o.na + nf for nf in o.nf), nk=o.nk)
    plant_errors = task.errors.of_orders(plant_orders)
    plant_task = replace(task, errors=plant_errors, constraints=of_plant, optimum=None)
    plant, fit = prediction_estimate(plant_task, None if shared else 1)
    errors = plant_errors.of_orders(o)  # on the same stretches
    problem, units = scaled_problem(errors)
    scaled, scales = problem.errors, units.scales
    fitted = [
        (_noise_start(problem, units, plant, division), division)
        for division in _divisions(plant.model, o, of_plant, task.sampling_rate)
    ]
    values = [float(problem.values(point[None, :])[0]) for point, _ in fitted]
    best: SearchResult | None = None
    for row in np.argsort(values, kind="stable")[:REFINED_DIVISIONS]:
        point, divided = fitted[int(row)]
        noise = _noise_fit(task, problem, of_noise, point)
        if best is None or noise.value < best.value:
            best, division = noise, divided
    assert best is not None
    unscaled = replace(plant.search, point=units.restored(best.point), value=plant.search.value)
    result = describe(errors, unscaled, task.sampling_rate)
    covariance = _simulation_covariance(task, scaled, best.point, fit, scales, division)
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
    if orders.na and not _has_shared_poles(orders):
        of_plant = {f"f{k[1:]}" if k[0] == "a" else k: v for k, v in of_plant.items()}
        plant_priors = tuple(
            replace(p, quantity=f"f{p.quantity[1:]}")
            if p.quantity[0] == "a" and p.quantity[1:].isdecimal()
            else p
            for p in plant_priors
        )
    plant = replace(constraints, fixed_coefficients=of_plant, priors=plant_priors)
    return plant, Constraints(fixed_coefficients=of_noise, priors=noise_priors)


def _has_shared_poles(orders: Orders) -> bool:
    """Whether several inputs share the poles of A; of one input they are those of an F."""
    return orders.inputs > 1 and orders.na > 0


def _divisions(
    plant: PolynomialModel, orders: Orders, constraints: Constraints, sampling_rate: float
) -> Iterator[Plant]:
    """The ways to divide the plant's denominators into A and F_i with real coefficients."""
    unity = np.ones(1)
    if orders.na == 0 or _has_shared_poles(orders):
        yield plant.A, plant.F
        return
    denominator = plant.F[0]
    if orders.single.nf == 0:
        yield denominator, (unity,)
        return
    poles = roots(denominator[1:])
    units = [np.array([z, z.conjugate()]) for z in poles if z.imag > 0.0]
    units += [np.array([z]) for z in poles if z.imag == 0.0]
    of_product = Orders(nb=1, nf=orders.na + orders.single.nf)
    fixed = plant_polynomial("f", constraints, of_product, sampling_rate, 1.0)
    known = roots(getattr(fixed, "factor", unity)[1:])
    held = [
        k for k, unit in enumerate(units) if any(np.min(np.abs(unit - z)) < 1e-6 for z in known)
    ]
    others = [k for k in range(len(units)) if k not in held]
    subsets = chain.from_iterable(combinations(others, k) for k in range(len(others) + 1))
    fitting = [of_a for of_a in subsets if sum(len(units[k]) for k in of_a) == orders.na]
    if not fitting:
        raise InputError(
            "structure",
            f"the poles of the plant that simulates best cannot be divided into na = {orders.na} "
            f"and nf = {orders.single.nf} with real coefficients",
            "use even na and nf, or a structure with one of the two",
        )
    for of_a in fitting:
        of_f = [k for k in range(len(units)) if k not in of_a]
        a, f = (np.real(np.poly(np.concatenate([units[k] for k in of]))) for of in (of_a, of_f))
        yield a, (f,)


def _noise_start(
    problem: PolynomialProblem, units: Units, plant: PolynomialEstimate, division: Plant
) -> Array:
    """A scaled point with a plant, and C and D by Hannan & Rissanen (1982)."""
    errors, model, (a, f) = problem.errors, plant.model, division
    parts, point, o = errors.parts, np.zeros(errors.dimension), errors.orders
    point[parts["a"]] = a[1:]
    for i, coefficients in enumerate(f):
        point[o.part("f", i)] = coefficients[1:]
    point[parts["b"]] = np.concatenate(model.B)
    levels = plant.levels or (model.level,) * errors.levels
    at_one = float(np.sum(a)) / float(np.sum(model.A))
    point[parts["level"]] = np.array(levels) * at_one
    point = units.taken(point)
    point[parts["plant"]] = 0.0
    states = errors.linear("plant", "noise")
    if states.any():
        point = solve_linear(errors, point[None, :], states, LINEAR_STEPS[errors.objective])[0]
    if o.nc or o.nd:
        point[parts["c"]], point[parts["d"]] = noise_model(errors.residuals(point), o.nc, o.nd)
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
    errors = without_plant_radius(problem.errors)
    parts = errors.parts
    free, priors = coordinates_of(task, errors, of_noise, levels=point[parts["level"]])
    held = {
        name: Linear(point[part], np.zeros((part.stop - part.start, 0)))
        for name, part in free.parts.items()
        if name[0] in "abf"
    }
    parameters = ConstrainedParameters(free.polynomials | held)
    weight = weight_of_priors(errors, priors, errors.residuals(point))
    constrained = CoordinateErrors(errors, parameters, priors, weight)
    white = point.copy()
    white[parts["c"]] = white[parts["d"]] = 0.0
    random = problem.spread(task.random_starts, task.generator(0, 3))[0]
    starts = np.array([parameters.coordinates(start) for start in (point, white, *random)])
    starts[:, parameters.linear] = 0.0
    starts = starts[np.isfinite(constrained.values(starts))]
    if not len(starts):
        lacking = "no invertible noise model with the fixed coefficients was found"
        remedy = "check the fixed coefficients of C and D"
        raise InputError("constraints", lacking, remedy, "fixed_coefficients")
    if parameters.linear.any():
        steps = LINEAR_STEPS[errors.objective]
        starts = solve_linear(constrained, starts, parameters.linear, steps)
    if not len(parameters.codes):
        # A noise model without coefficients or states.
        value = float(errors.values(point[None, :])[0])
        return SearchResult(point, value, SearchDiagnostics.none())
    optimum = multistart(constrained, starts, float(np.min(constrained.values(starts))))
    return replace(optimum, point=constrained.points(optimum.point[None, :])[0])


def _simulation_covariance(
    task: EstimationTask,
    errors: PolynomialErrors,
    point: Array,
    fit: Fitted,
    scales: Array,
    division: Plant,
) -> ParameterCovariance | None:
    """Of the plant from coloured simulation errors, and of C and D fitted given the plant."""
    o, parts = task.errors.orders, errors.parts
    if errors.objective == "absolute":
        return None
    of_noise = _divided_constraints(task.constraints, o)[1]
    parameters, priors = coordinates_of(task, errors, of_noise, radius=UNBOUNDED_RADIUS)
    jacobian = errors.jacobian(point)
    deviation = loss_deviation(errors.residuals(point), errors.dimension, "quadratic")
    c, d = (np.append(1.0, point[parts[name]]) for name in "cd")
    columns = np.r_[parts["c"], parts["d"], parts["plant"], parts["noise"]]
    held = np.r_[parts["a"], parts["b"], parts["f"], parts["level"]]
    # C and D are linear in their coordinates, wherever these are.
    none = np.zeros(len(parameters.codes))
    bases = [parameters.polynomials[name].part(none[parameters.columns[name]])[1] for name in "cd"]
    second = Fitted(
        jacobian[:, columns],
        scipy.linalg.block_diag(*bases, np.eye(len(columns) - o.nc - o.nd)),
        priors.deviations(point)[1][:, columns],
        errors.residual_counts(),
    )
    to_second = _to_held(o, division, point[parts["level"]], fit.jacobian.shape[1])
    noise_filter = c, np.convolve(division[0], d)
    covariance = two_stage_covariance(
        fit, second, noise_filter, to_second, jacobian[:, held], deviation
    )
    before_f = o.na + sum(o.nb)
    of_f = before_f + np.arange(sum(o.nf))
    of_c_and_d = len(held) + np.arange(o.nc + o.nd)
    order = np.r_[np.arange(before_f), of_c_and_d, of_f]
    coefficients = ParameterCovariance(covariance.factor[order], covariance.null_space[order])
    return of_coefficients(coefficients, len(order), scales)


def _to_held(orders: Orders, division: Plant, levels: Array, size: int) -> Array:
    """Derivatives of [a, b, f, levels] by [a, b, c, f, ...], or by [b, A F, levels, ...]."""
    if _has_shared_poles(orders):
        places = np.arange(orders.na * 2 + sum(orders.nb) + sum(orders.nf) + len(levels))
        of_c = orders.na + sum(orders.nb) + np.arange(orders.na)
        return np.eye(size)[np.delete(places, of_c)]
    na, nb, nf, (a, f) = orders.na, sum(orders.nb), sum(orders.nf), division
    divided: Array = np.eye(na + nf)
    if na and nf:
        # d(A F) = F dA + A dF.
        parts = scipy.linalg.convolution_matrix(f[0], na), scipy.linalg.convolution_matrix(a, nf)
        divided = np.asarray(np.linalg.pinv(np.hstack(parts)))
    derivatives = np.zeros((na + nb + nf + len(levels), size))
    of_product = slice(nb, nb + na + nf)
    derivatives[:na, of_product] = divided[:na]
    derivatives[na : na + nb, :nb] = np.eye(nb)
    derivatives[na + nb : na + nb + nf, of_product] = divided[na:]
    # A level of the equation is A(1) times that of the output.
    at_one = float(np.sum(a))
    for k, level in enumerate(levels):
        row = derivatives[na + nb + nf + k]
        row[nb + na + nf + k] = at_one
        row += level / at_one * derivatives[:na].sum(axis=0)
    return derivatives


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
    """Find the polynomial model of given orders with the smallest errors in focus, globally.

    One objective over all segments, each with initial states, and each recording with a level where
    one is estimated: ``A y = (B/F) u + (C/D) e + level``.  ARMAX models of one input and segment
    without a level alone use ``n_initial_discard``.  Draws come from ``SeedSequence(seed,
    spawn_key=(na, *nb, nc, nd, *nf, *nk, level))``.

    ``earlier``: a search of the same problem, without focus or constraints, to combine with this
    one.  ``optimum``: of one-step prediction without constraints, where these or a focus are given.
    ``target``: what the search is made for; it ends once it is unlikely to get so low.

    Criteria and residuals are those of one step.  The covariance is zero across active constraints,
    counts priors as observations, and is None for absolute errors of several steps.  InputError
    when constraints contradict each other, the structure or the focus; ValueError when the record
    is too short, or a setting is outside its range.
    """
    settings = settings or SearchSettings()
    # Output-error models of several inputs have more optima than 20,000 evaluations tell apart.
    many = settings.evaluations * max(data.inputs.shape[1], 1) ** 2
    settings = replace(settings, evaluations=many)
    rate, names = data.sampling_rate, data.input_names
    with one_blas_thread():
        errors = checked_errors(data, orders, settings, window, level)
        horizon = check_fit(focus, constraints, orders, rate, names)
        plain = constraints is None and focus == "prediction"
        if earlier is not None and not plain:
            raise ValueError("an earlier search has neither focus nor constraints: give none")
        given = settings, constraints or Constraints(), names
        task = EstimationTask(errors, rate, *given, log, optimum, earlier, target)
        if orders.structure in REGULARISED:
            fitted = estimate_response(errors, rate)
        elif plain:
            result = searched(task, *scaled_problem(errors))
            fitted = describe(errors, result, rate, shortest=True)
        elif horizon is None:
            fitted = simulation_estimate(task)
        else:
            fitted = prediction_estimate(task, horizon)[0]
    effect = fitted.constraints if constraints is not None else None
    return replace(fitted, model=of_signals(fitted.model, data), focus=focus, constraints=effect)
