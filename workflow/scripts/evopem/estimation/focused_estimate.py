"""Estimates for k-step prediction or for simulation, and estimates under constraints.

One step or k steps: the optimum without constraints is searched first.  Where it meets them it is
the result; elsewhere descents start from it, from the linear estimates of the search and from
random points, each moved into the region, in coordinates that cannot leave the region.

Simulation: the plant ``B / (A F)`` is fitted by output error; C and D are then fitted to the
one-step prediction errors with the plant held.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from evopem.config.constraints import Constraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.errors import InputError
from evopem.estimation.constrained_model import constrained_parameters, equalities, priors_of
from evopem.estimation.constraint_checks import check_constraints
from evopem.estimation.pem.constrained_errors import ConstrainedErrors
from evopem.estimation.pem.constrained_parameters import ConstrainedParameters
from evopem.estimation.pem.focus_covariance import (
    Fitted,
    loss_deviation,
    tangent_covariance,
    two_stage_covariance,
)
from evopem.estimation.pem.k_step_errors import KStepErrors
from evopem.estimation.pem.pole_region import UNBOUNDED_RADIUS
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.pem.priors import Priors
from evopem.estimation.polynomial_estimate import (
    ConstraintEffect,
    PolynomialEstimate,
    check_record,
    described,
    scaled_problem,
)
from evopem.estimation.search.linear_completion import LINEAR_STEPS, solve_linear
from evopem.estimation.search.memetic import memetic_search
from evopem.estimation.search.multistart import multistart
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.estimation.search.starting_polynomials import noise_model
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomials import roots
from evopem.models.structures import PolynomialOrders, orders_of

Array = NDArray[np.float64]
Log = Callable[[str], None]
Focus = str | int

# Random starts of the descents under constraints and of k-step errors.
RANDOM_STARTS = 24
# Random draws from which starts that meet fixed coefficients are taken.
DRAWS = 512
# Relative distance within which a point counts as one that meets the constraints.
MEETS = 1e-9
# Ways to divide the plant's poles between A and F of which the noise model is refined.
REFINED_DIVISIONS = 3


# Diagnostics of a noise model without coefficients or states.
NO_SEARCH = SearchDiagnostics(0, 0, (), 0, 0, 0, 1.0, ())


@dataclass(frozen=True)
class _Task:
    """A record, orders and settings, checked."""

    errors: PolynomialErrors
    structure: str
    sampling_rate: float
    settings: SearchSettings
    constraints: Constraints
    log: Log | None

    @property
    def orders(self) -> PolynomialOrders:
        return self.errors.orders

    def generator(self, purpose: int) -> np.random.Generator:
        o = self.orders
        key: tuple[int, ...] = (o.na, o.nb, o.nc, o.nd, o.nf, o.nk, int(self.errors.level))
        key = (*key, purpose) if purpose else key
        return np.random.default_rng(np.random.SeedSequence(self.settings.seed, spawn_key=key))


def estimate_focused(
    input: ArrayLike | None,  # noqa: A002 - the field's word
    output: ArrayLike,
    structure: str,
    orders: PolynomialOrders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    focus: Focus = "prediction",
    constraints: Constraints | None = None,
    log: Log | None = None,
) -> PolynomialEstimate:
    """Find the polynomial model with the smallest errors in focus that meets constraints.

    Parameters are those of :func:`.polynomial_estimate.estimate_polynomial`, and:

    Parameters
    ----------
    focus : {"prediction", "simulation"} or int
        Errors of one step, of simulation, or of predictions that many samples ahead.
    constraints : Constraints, optional

    Returns
    -------
    PolynomialEstimate
        ``criteria`` and ``residuals`` are those of one step; ``focus_objective`` is that of the
        errors in focus.  The covariance is zero across active constraints, counts priors as
        observations, and allows for the colour of k-step and simulation errors by the noise model
        (:func:`.focus_covariance.tangent_covariance`, :func:`.focus_covariance.two_stage_covariance`).
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
    y = np.ascontiguousarray(output, dtype=float)
    if input is None and o.nb:
        raise ValueError(f"structure {structure!r} with nb = {o.nb} needs an input")
    u = np.zeros_like(y) if input is None else np.ascontiguousarray(input, dtype=float)
    window = window or ScoringWindow(o.first_residual, o.first_residual)
    horizon = _horizon(focus, o)
    check_record(u, y, o, settings, window)
    if constraints is not None:
        check_constraints(constraints, o, sampling_rate)
    radius = settings.max_root_radius
    errors = PolynomialErrors(
        u,
        y,
        o,
        settings.objective,
        window.residual_start,
        window.loss_start,
        radius,
        radius,
        level,
    )
    known = constraints or Constraints()
    task = _Task(errors, structure, sampling_rate, settings, known, log)
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with threadpool_limits(limits=1, user_api="blas"):
        found = _simulation(task) if horizon is None else _prediction(task, horizon)[0]
    effect = found.constraints if constraints is not None else None
    return replace(found, focus=focus, constraints=effect)


def _horizon(focus: Focus, orders: PolynomialOrders) -> int | None:
    """Samples ahead; None for simulation where that differs from prediction."""
    whole = isinstance(focus, int) and not isinstance(focus, bool) and focus >= 1
    if not whole and focus not in ("prediction", "simulation"):
        raise ValueError(
            f'focus must be "prediction", "simulation" or a number of samples, not {focus!r}'
        )
    if focus == "simulation" and orders.nb == 0:
        raise ValueError("a model without input has nothing to simulate; use focus='prediction'")
    if orders.na == 0 and orders.nc == 0 and orders.nd == 0:
        # The noise is white: predictions are simulations, whatever the horizon.
        return 1
    if focus == "simulation":
        return None
    return int(focus) if whole else 1


def _prediction(task: _Task, horizon: int) -> tuple[PolynomialEstimate, Fitted]:
    """The estimate for errors of k steps, and what its covariance follows from."""
    problem, scales = scaled_problem(task.errors)
    scaled = problem.errors
    b_scale = float(scales[scaled.parts()["b"]][0]) if task.orders.nb else 1.0
    free = _unconstrained(task, problem, horizon, b_scale)
    k_errors = _k_step(scaled, horizon)
    parameters = constrained_parameters(
        task.constraints,
        task.orders,
        scaled.level,
        task.sampling_rate,
        scaled.plant_radius,
        b_scale,
    )
    priors = priors_of(task.constraints, parameters, task.orders, task.sampling_rate, b_scale)
    k_residuals = _scored(k_errors, free.point)
    deviation = loss_deviation(k_residuals, scaled.dimension, scaled.objective)
    if priors.terms and not np.isfinite(deviation):
        raise ValueError(
            "the weight of the priors is not known: the residuals have no density at 0"
        )
    weight = _prior_weight(scaled, deviation) if priors.terms else 0.0
    bounded = parameters.coordinates(free.point)
    nearest = parameters.point(bounded)[0]
    if not priors.terms and _meets(parameters, bounded, free.point, nearest):
        found, (active, tangent) = free, parameters.active(parameters.unbounded(bounded, 0.0))
    else:
        wide = _with_radius(scaled, UNBOUNDED_RADIUS)
        constrained = ConstrainedErrors(_k_step(wide, horizon), parameters, priors, weight)
        starts = _starts(task, problem, constrained, free.point)
        found = multistart(constrained, starts, max(free.value, 1e-300))
        z = parameters.snapped(found.point)
        if not constrained.values(z[None, :])[0] <= found.value * (1.0 + 1e-6):
            z = found.point
        active, tangent = parameters.active(z)
        found = replace(found, point=parameters.point(parameters.bounded(z)[0])[0])
    prior_rows = priors.deviations(found.point)[1]
    covariance = _covariance(scaled, k_errors, found.point, tangent, prior_rows, horizon)
    objective, without = (
        _objective(scaled, _scored(k_errors, point)) for point in (found.point, free.point)
    )
    unscaled = replace(found, point=found.point * scales)
    result = described(task.errors, unscaled, task.structure, task.sampling_rate)
    coefficients = task.orders.parameters
    covariance = covariance and _scaled_covariance(covariance, scales, coefficients)
    estimate = replace(
        result,
        model=replace(result.model, covariance=covariance),
        focus_objective=objective,
        constraints=ConstraintEffect(objective, without, (*equalities(task.constraints), *active)),
    )
    return estimate, Fitted(k_errors.jacobian(found.point), tangent, prior_rows)


def _unconstrained(
    task: _Task, problem: PolynomialProblem, horizon: int, b_scale: float
) -> SearchResult:
    """The optimum without constraints, but with unstable plants where these are allowed."""
    found = memetic_search(
        problem, task.settings, task.generator(0), task.log, recombine=problem.recombine
    )
    if horizon == 1 and task.constraints.stability == "required":
        return found
    scaled = problem.errors
    k_errors = _k_step(scaled, horizon)
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
    wide = _with_radius(scaled, UNBOUNDED_RADIUS)
    constrained = ConstrainedErrors(
        _k_step(wide, horizon), parameters, Priors((), parameters.parts, task.sampling_rate), 0.0
    )
    starts = np.concatenate([starts, _least_squares_start(wide)])
    z = np.array([parameters.unbounded(parameters.coordinates(point)) for point in starts])
    found = multistart(constrained, z, found.value)
    return replace(found, point=constrained.points(found.point[None, :])[0])


def _least_squares_start(errors: PolynomialErrors) -> Array:
    """The ARX model of least squares, its poles wherever they are, (1, n)."""
    point = np.zeros((1, errors.dimension))
    linear = np.ones(errors.dimension, dtype=bool)
    for name in ("c", "d", "f", "plant"):
        linear[errors.parts()[name]] = False
    return solve_linear(errors, point, linear, LINEAR_STEPS[errors.objective])


def _starts(
    task: _Task, problem: PolynomialProblem, constrained: ConstrainedErrors, free: Array
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


def _k_step(errors: PolynomialErrors, horizon: int) -> PolynomialErrors | KStepErrors:
    return errors if horizon == 1 else KStepErrors(errors, horizon)


def _with_radius(errors: PolynomialErrors, radius: float) -> PolynomialErrors:
    """The same problem where roots of A and F are held by the coordinates alone."""
    return PolynomialErrors(
        errors.input,
        errors.output,
        errors.orders,
        errors.objective,
        errors.residual_start,
        errors.loss_start,
        radius,
        errors.noise_radius,
        errors.level,
    )


def _scored(errors: PolynomialErrors | KStepErrors, point: Array) -> Array:
    residuals = errors.residuals(point)
    return residuals[errors.loss_start :] if isinstance(errors, PolynomialErrors) else residuals


def _objective(errors: PolynomialErrors, residuals: Array) -> float:
    losses = np.abs(residuals) if errors.objective == "absolute" else residuals**2
    return float(errors.loss_factor * np.sum(losses))


def _prior_weight(errors: PolynomialErrors, deviation: float) -> float:
    """What a squared deviation adds to the objective: as much as one more observation."""
    if errors.objective == "quadratic":
        return errors.loss_factor * deviation**2
    return 0.5 * errors.loss_factor * deviation


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


def _scaled_covariance(
    covariance: ParameterCovariance, scales: Array, coefficients: int
) -> ParameterCovariance:
    """The covariance of the coefficients alone, in the units of the record."""
    null_space = covariance.null_space[:coefficients] * scales[:coefficients, None]
    null_space = null_space[:, np.any(null_space != 0.0, axis=0)]
    factor = covariance.factor[:coefficients] * scales[:coefficients, None]
    return ParameterCovariance(factor, null_space)


def _simulation(task: _Task) -> PolynomialEstimate:
    """The estimate for simulation errors: output error, then the noise model given the plant."""
    o, errors = task.orders, task.errors
    if task.constraints.stability == "free":
        raise InputError(
            "constraints",
            "simulation errors need a stable plant",
            "fit for prediction, or fix the pole that is not stable",
            "stability",
        )
    of_plant, of_noise = _divided_constraints(task.constraints, o)
    plant_orders = PolynomialOrders(nb=o.nb, nf=o.na + o.nf, nk=o.nk)
    plant_task = replace(
        task, errors=errors.of_orders(plant_orders), structure="oe", constraints=of_plant
    )
    plant, fit = _prediction(plant_task, 1)
    problem, scales = scaled_problem(errors)
    fitted = [
        (_noise_start(problem, scales, plant, a, f), a, f)
        for a, f in _divisions(plant.model.f, o, of_plant, task.sampling_rate)
    ]
    values = [float(problem.values(point[None, :])[0]) for point, _, _ in fitted]
    best: SearchResult | None = None
    for row in np.argsort(values, kind="stable")[:REFINED_DIVISIONS]:
        point, a, f = fitted[int(row)]
        found = _noise_fit(task, problem, of_noise, point, scales)
        if best is None or found.value < best.value:
            best, division = found, (a, f)
    assert best is not None
    unscaled = replace(plant.search, point=best.point * scales, value=plant.search.value)
    result = described(errors, unscaled, task.structure, task.sampling_rate)
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
    constraints: Constraints, orders: PolynomialOrders
) -> tuple[Constraints, Constraints]:
    """Constraints of the output-error model ``B / F``, F being A F, and those of C and D."""
    of_noise = {k: v for k, v in constraints.fixed_coefficients.items() if k[0] in "cd"}
    of_plant = {k: v for k, v in constraints.fixed_coefficients.items() if k[0] in "abf"}
    noise_priors = tuple(
        p for p in constraints.priors if p.quantity[0] in "cd" and p.quantity[1:].isdecimal()
    )
    plant_priors = tuple(p for p in constraints.priors if p not in noise_priors)
    if orders.na and orders.nf:
        named = [k for k in of_plant if k[0] in "af"]
        named += [
            p.quantity for p in plant_priors if p.quantity[0] in "af" and p.quantity[1:].isdecimal()
        ]
        if named:
            raise InputError(
                "constraints",
                "a fit for simulation determines only the product of A and F",
                "leave it out, or use a structure with one of the two",
                named[0],
            )
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
    denominator: Array, orders: PolynomialOrders, constraints: Constraints, sampling_rate: float
) -> Iterator[tuple[Array, Array]]:
    """The ways to divide the plant's denominator into A and F with real coefficients."""
    one = np.ones(1)
    if orders.nf == 0 or orders.na == 0:
        yield (denominator, one) if orders.na else (one, denominator)
        return
    poles = roots(denominator[1:])
    units = [np.array([z, z.conjugate()]) for z in poles if z.imag > 0.0]
    units += [np.array([z]) for z in poles if z.imag == 0.0]
    fixed = constrained_parameters(
        constraints, PolynomialOrders(nb=1, nf=orders.na + orders.nf), False, sampling_rate, 1.0
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
            f"and nf = {orders.nf} with real coefficients",
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
    task: _Task, problem: PolynomialProblem, of_noise: Constraints, point: Array, scales: Array
) -> SearchResult:
    """C and D with the smallest one-step errors, the plant and the level held."""
    errors = _with_radius(problem.errors, UNBOUNDED_RADIUS)
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
    weight = _prior_weight(errors, deviation) if priors.terms else 0.0
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
        return SearchResult(point, float(errors.values(point[None, :])[0]), NO_SEARCH)
    largest = float(np.min(constrained.values(starts)))
    found = multistart(constrained, starts, largest)
    return replace(found, point=constrained.points(found.point[None, :])[0])


def _simulation_covariance(
    task: _Task,
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
        block_diag(*bases, np.eye(o.nf + o.noise_states)),
        priors.deviations(point)[1][:, columns],
    )
    to_second = _to_held(o, a, f, float(point[parts["level"]].sum()), fit.jacobian.shape[1])
    covariance = two_stage_covariance(
        fit, second, (c, np.convolve(a, d)), to_second, jacobian[:, held], deviation
    )
    before_f, level = o.na + o.nb, int(errors.level)
    of_f = before_f + np.arange(o.nf)
    of_c_and_d = len(held) + np.arange(o.nc + o.nd)
    order = np.r_[np.arange(before_f), of_c_and_d, of_f]
    assert len(held) == before_f + o.nf + level
    return _scaled_covariance(
        ParameterCovariance(covariance.factor[order], covariance.null_space[order]),
        scales,
        len(order),
    )


def _to_held(orders: PolynomialOrders, a: Array, f: Array, level: float, size: int) -> Array:
    """Derivatives of [a, b, f, level] by the point [b, A F, level, state] of output error."""
    na, nf, nb = orders.na, orders.nf, orders.nb
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
