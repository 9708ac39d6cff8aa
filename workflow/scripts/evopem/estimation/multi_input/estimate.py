"""Estimate polynomial models with several inputs and one output, and reduce their orders."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from evopem.config.constraints import InputConstraints
from evopem.config.settings import SearchSettings
from evopem.config.structures import STRUCTURES
from evopem.estimation.criteria import lies_at_bound
from evopem.estimation.damped_descent import Optimum
from evopem.estimation.multi_input.constrained import (
    check_input_constraints,
    constrained_inputs,
    constrained_optimum,
)
from evopem.estimation.multi_input.covariance import parameter_covariance
from evopem.estimation.multi_input.descent import descend
from evopem.estimation.multi_input.errors import (
    MultiInputErrors,
    MultiInputRecord,
    multi_input_record,
)
from evopem.estimation.multi_input.order_limits import OrderLimits
from evopem.estimation.multi_input.problem import (
    POLISH_STEPS,
    POLISH_TOLERANCE,
    STEPS,
    TOLERANCE,
    MultiInputProblem,
    adapted_point,
    descended,
    starting_points,
)
from evopem.estimation.polynomial_estimate import ConstraintEffect
from evopem.estimation.search.global_search import global_search
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.estimation.state_space.noise_colour import autoregression_of, limited
from evopem.models.multi_input import MultiInputModel, MultiInputOrders, multi_input_orders

Array = NDArray[np.float64]
Log = Callable[[str], None]

SETTINGS = SearchSettings(
    objective="quadratic", mu=8, lambda_=16, nu=6, refine="random", evaluations=10_000
)
"""Settings of the search where none are given."""

# Starts of each order that are descended from on the way to a larger order, and for the order
# itself.
WIDTH, FINAL_WIDTH = 3, 8
# Last number of the key of the draws under constraints.
CONSTRAINED = 1
# Steps of a descent after which a model of smaller orders is scored.
REDUCTION_STEPS = 20


@dataclass(frozen=True, eq=False)
class MultiInputEstimate:
    """An estimated model, its criteria, and the search that found it.

    Attributes
    ----------
    model : MultiInputModel
        With the covariance of its coefficients and level.
    objective : float
        ``100 sum e^2 / sum y^2`` in percent, y less its mean; of the absolute objective
        ``100 sum |e| / sum |y|``.
    fit_percent : (1,) array
        ``100 (1 - ||e|| / ||y - mean(y)||)``.
    bic : float
        ``ln(||e||^2 / N) + n ln(N) / N``, the level among the n parameters; of the absolute
        objective ``2 ln(sum |e| / N)`` takes the place of the first term.
    coloured_bic : float
        The same of the innovations of an autoregression of the errors, whose coefficients are
        counted as parameters: it compares models with and without a noise model.
    residuals : tuple of (N,) arrays
        One for each record; NaN before the first.
    at_stability_bound : bool
        Whether a root of A, C, D or F_i lies at the largest radius allowed.
    search : SearchResult
    constraints : ConstraintEffect, optional
        What the constraints took; None without any.
    """

    model: MultiInputModel
    objective: float
    fit_percent: Array
    bic: float
    coloured_bic: float
    residuals: tuple[Array, ...] = field(repr=False)
    at_stability_bound: bool
    search: SearchResult = field(repr=False)
    constraints: ConstraintEffect | None = None

    @property
    def plant_states(self) -> int:
        """States of the plant in state space."""
        return self.model.plant_states


@dataclass(frozen=True)
class TriedOrders:
    """Smaller orders that were tried.

    Attributes
    ----------
    orders : MultiInputOrders
    bic, bic_before : float
        Theirs, and that of the orders which they would replace.
    """

    orders: MultiInputOrders
    bic: float
    bic_before: float

    @property
    def taken(self) -> bool:
        """Whether BIC fell."""
        return self.bic < self.bic_before


@dataclass(frozen=True)
class ReducedOrders:
    """The orders of lowest BIC, and all that were tried on the way."""

    orders: MultiInputOrders
    tried: tuple[TriedOrders, ...]


def estimate_multi_input(
    inputs: ArrayLike | Sequence[ArrayLike],
    output: ArrayLike | Sequence[ArrayLike],
    orders: MultiInputOrders | Mapping[str, Any] | Sequence[Any],
    structure: str = "armax",
    sampling_rate: float = 1.0,
    *,
    settings: SearchSettings | None = None,
    constraints: InputConstraints | None = None,
    input_names: Sequence[str] = (),
    output_name: str = "",
    log: Log | None = None,
) -> MultiInputEstimate:
    """Find the model of some orders with the smallest sum of squared, or absolute, one-step errors.

    Parameters
    ----------
    inputs : (N, nu) array_like, or a list of them
        One record or several; not modified.
    output : (N,) or (N, 1) array_like, or a list of them
    orders : MultiInputOrders, mapping or sequence
        Of nb, nf and nk one number for all inputs, or a list with one for each.
    structure : str
        ``fir``, ``arx``, ``armax``, ``ararx``, ``ararmax``, ``oe``, ``bj`` or ``general``.
    sampling_rate : float
        Hz.
    settings : SearchSettings, optional
        :data:`SETTINGS`, with the quadratic objective, by default.  The draws come from
        ``SeedSequence(seed, spawn_key=...)`` of the orders.
    constraints : InputConstraints, optional
        What the model must meet; without ``input_names`` the inputs are called 1, 2, ...
    input_names : sequence of str, optional
    output_name : str
    log : callable, optional
        Receives one line a restart.

    Raises
    ------
    InputError
        When constraints contradict each other or the orders.
    ValueError
        When orders and structure do not fit, or the record is too short.

    Examples
    --------
    >>> generator = np.random.default_rng(1)
    >>> u, e = generator.standard_normal((400, 2)), 0.1 * generator.standard_normal(400)
    >>> y = np.zeros(400)
    >>> for t in range(2, 400):
    ...     y[t] = 0.8 * y[t - 1] + u[t - 1, 0] - 0.5 * u[t - 2, 1] + e[t] + 0.4 * e[t - 1]
    >>> found = estimate_multi_input(u, y, {"na": 1, "nb": 1, "nc": 1, "nk": [1, 2]})
    >>> found.model.A.round(2), [b.round(1).tolist() for b in found.model.B]
    (array([ 1. , -0.8]), [[1.0], [-0.5]])
    """
    settings = settings or SETTINGS
    us, ys = _records(inputs, output)
    wanted = multi_input_orders(structure, orders, us[0].shape[1])
    names = tuple(input_names) or tuple(str(k + 1) for k in range(wanted.inputs))
    if constraints is not None:
        check_input_constraints(constraints, wanted, names, sampling_rate)
    with threadpool_limits(limits=1, user_api="blas"):
        record = _record(us, ys, wanted, wanted.first_residual)
        errors = MultiInputErrors(record, wanted, settings.max_root_radius, settings.objective)
        found = _searched(errors, settings, log)
        if constraints is None:
            estimate = _described(errors, found, sampling_rate)
        else:
            parameters = constrained_inputs(constraints, errors, names, sampling_rate)
            generator = _generator(errors, settings, CONSTRAINED)
            best = constrained_optimum(errors, parameters, found, generator)
            estimate = _described(errors, best.result, sampling_rate, best.tangent)
            given = [key for key in ("static_gain",) if getattr(constraints, key)]
            given += ["fixed_poles"] if constraints.poles.fixed_poles else []
            effect = ConstraintEffect(best.result.value, found.value, (*given, *best.active))
            estimate = replace(estimate, constraints=effect)
    model = replace(estimate.model, input_names=tuple(input_names), output_name=output_name)
    return replace(estimate, model=model)


def multi_input_estimates(
    inputs: ArrayLike | Sequence[ArrayLike],
    output: ArrayLike | Sequence[ArrayLike],
    orders: Mapping[int, MultiInputOrders],
    settings: SearchSettings | None = None,
    log: Log | None = None,
) -> Iterator[tuple[int, MultiInputEstimate]]:
    """Estimates of ascending orders, each from linear estimates and from smaller models.

    All are scored on the same samples.  The sampling rate is 1 Hz.

    Parameters
    ----------
    inputs, output
        As of :func:`estimate_multi_input`.
    orders : mapping of int to MultiInputOrders
        Ascending, by the joint order that they follow.
    settings : SearchSettings, optional
    log : callable, optional
    """
    settings = settings or SETTINGS
    us, ys = _records(inputs, output)
    largest = orders[max(orders)]
    record = _record(us, ys, largest, largest.first_residual)
    smaller: list[MultiInputModel] = []
    for order, wanted in orders.items():
        errors = MultiInputErrors(record, wanted, settings.max_root_radius, settings.objective)
        with threadpool_limits(limits=1, user_api="blas"):
            found = _descents(errors, smaller[-2:], settings, WIDTH)
            if not found:
                continue
            estimate = _described(errors, _without_generations(found), 1.0)
        smaller.append(_in_scaled_units(errors, found[0].point))
        if log is not None:
            log(f"{wanted}: {estimate.objective:.9g} %")
        yield order, estimate


def refitted_multi_input(
    model: MultiInputModel,
    inputs: Sequence[ArrayLike],
    outputs: Sequence[ArrayLike],
    settings: SearchSettings,
) -> MultiInputModel:
    """The optimum of other records that a descent from a model ends at.

    Of the settings the objective and the largest radius of roots are used.

    Raises
    ------
    ValueError
        When the records are too short, or no errors are finite.
    """
    us, ys = _records(inputs, outputs)
    with threadpool_limits(limits=1, user_api="blas"):
        record = _record(us, ys, model.orders, model.orders.first_residual)
        errors = MultiInputErrors(
            record, model.orders, settings.max_root_radius, settings.objective
        )
        found = descend(errors, errors.point_of(model), STEPS, TOLERANCE)
        if not np.isfinite(found.value):
            raise ValueError("the descent found no finite errors")
        variance = float(np.mean(errors.residuals(found.point) ** 2))
        return errors.model(found.point, model.sampling_rate, variance)


def reduced_orders(
    inputs: ArrayLike | Sequence[ArrayLike],
    output: ArrayLike | Sequence[ArrayLike],
    orders: MultiInputOrders,
    settings: SearchSettings | None = None,
    limits: OrderLimits | None = None,
    log: Log | None = None,
) -> ReducedOrders:
    """Smaller orders of lower BIC, each input its own, and its delay.

    One coefficient of B_i at either end, one of another polynomial, a pole with a zero, or a factor
    of A and all B_i is left out at a time, as long as BIC falls.  All are scored on the same
    samples.

    Parameters
    ----------
    inputs, output
        As of :func:`estimate_multi_input`.
    orders : MultiInputOrders
    settings : SearchSettings, optional
    limits : OrderLimits, optional
        Orders beyond them are not tried.
    log : callable, optional
    """
    settings = settings or SETTINGS
    us, ys = _records(inputs, output)
    tried: list[TriedOrders] = []
    with threadpool_limits(limits=1, user_api="blas"):
        record = _record(us, ys, orders, orders.first_residual)
        errors = MultiInputErrors(record, orders, settings.max_root_radius, settings.objective)
        found = _descents(errors, [], settings, FINAL_WIDTH)
        if not found:
            return ReducedOrders(orders, ())
        best = _bic(errors, found[0].value)
        model = _in_scaled_units(errors, found[0].point)
        falls = True
        while falls:
            falls = False
            for smaller in _smaller(orders):
                if limits is not None and not limits.allow(smaller):
                    continue
                own = errors.of_orders(smaller)
                optimum = descend(own, adapted_point(own, model), REDUCTION_STEPS, TOLERANCE)
                bic = _bic(own, optimum.value)
                tried.append(TriedOrders(smaller, bic, best))
                if bic < best:
                    best, orders, falls = bic, smaller, True
                    model = _in_scaled_units(own, optimum.point)
                    break
    if log is not None:
        log(f"orders of lowest BIC: {orders}")
    return ReducedOrders(orders, tuple(tried))


def _smaller(orders: MultiInputOrders) -> Iterator[MultiInputOrders]:
    """Orders with one coefficient less, or with one pole and one zero less."""
    names = STRUCTURES[orders.structure]
    noise = [name for name in ("nc", "nd") if getattr(orders, name) > 0]
    if orders.na > 0 and min(orders.nb) > 1:
        # A factor of A and all B_i, which C has as well, or 1/D in its place.
        factored = replace(orders, na=orders.na - 1, nb=tuple(nb - 1 for nb in orders.nb))
        if orders.nc > 0:
            yield replace(factored, nc=orders.nc - 1)
        if "nd" in names:
            yield factored
    # A pole that a zero cancels goes with it.
    if len(noise) > 1:
        yield replace(orders, nc=orders.nc - 1, nd=orders.nd - 1)
    for name in noise:
        yield replace(orders, **{name: getattr(orders, name) - 1})
    for i in range(orders.inputs):
        nb, nf, nk = orders.nb[i], orders.nf[i], orders.nk[i]
        fewer_b = _with(orders.nb, i, nb - 1)
        if nf > 0:
            fewer_f = _with(orders.nf, i, nf - 1)
            if nb > 1:
                yield replace(orders, nf=fewer_f, nb=fewer_b)
            yield replace(orders, nf=fewer_f)
        if nb > 1:
            yield replace(orders, nb=fewer_b)
            yield replace(orders, nb=fewer_b, nk=_with(orders.nk, i, nk + 1))
    if "na" in names and orders.na > 0:
        yield replace(orders, na=orders.na - 1)


def _with(values: tuple[int, ...], place: int, value: int) -> tuple[int, ...]:
    return (*values[:place], value, *values[place + 1 :])


def _records(
    inputs: ArrayLike | Sequence[ArrayLike], output: ArrayLike | Sequence[ArrayLike]
) -> tuple[list[Array], list[Array]]:
    """(N, nu) inputs and (N,) outputs of each record."""
    several = isinstance(inputs, list | tuple) and np.ndim(inputs[0]) == 2
    us = [np.asarray(u, dtype=float) for u in (inputs if several else [inputs])]  # type: ignore[union-attr]
    ys = [np.asarray(y, dtype=float) for y in (output if several else [output])]  # type: ignore[union-attr]
    ys = [y[:, 0] if y.ndim == 2 and y.shape[1] == 1 else y for y in ys]
    if len(us) != len(ys):
        raise ValueError(f"{len(us)} records of inputs and {len(ys)} of the output do not match")
    for u, y in zip(us, ys, strict=True):
        if u.ndim != 2 or y.ndim != 1 or len(u) != len(y):
            raise ValueError(
                f"inputs must be (N, nu) and the output (N,), not {u.shape} and {y.shape}"
            )
        if not (np.isfinite(u).all() and np.isfinite(y).all()):
            raise ValueError("inputs and output must be finite")
    return us, ys


def _record(
    us: Sequence[Array], ys: Sequence[Array], orders: MultiInputOrders, start: int
) -> MultiInputRecord:
    """The record, when it determines the parameters."""
    states = 1 + sum(orders.nf) + orders.noise_states
    long = [(u, y) for u, y in zip(us, ys, strict=True) if len(y) > start + states]
    available = sum(len(y) - start for _, y in long)
    needed = orders.coefficients + states * len(long)
    if available <= needed:
        raise ValueError(
            f"{orders} needs more than {needed} residuals for its parameters and initial states;"
            f" the record has {max(available, 0)}"
        )
    if not any(np.ptp(y) > 0.0 for _, y in long):
        raise ValueError("the output is constant")
    return multi_input_record([u for u, _ in long], [y for _, y in long], start)


def _generator(
    errors: MultiInputErrors, settings: SearchSettings, *use: int
) -> np.random.Generator:
    o = errors.orders
    key = (list(STRUCTURES).index(o.structure), o.na, o.nc, o.nd, *o.nb, *o.nf, *o.nk, *use)
    return np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))


def _descents(
    errors: MultiInputErrors,
    smaller: Sequence[MultiInputModel],
    settings: SearchSettings,
    width: int,
) -> list[Optimum]:
    """Optima from estimates and from smaller models, the lowest first."""
    generator = _generator(errors, settings)
    own = starting_points(errors)
    added = [point for model in smaller for point in starting_points(errors, [model], generator)]
    found = descended(errors, own, width) + descended(errors, added, width)
    return sorted(found, key=lambda optimum: optimum.value)


def _searched(errors: MultiInputErrors, settings: SearchSettings, log: Log | None) -> SearchResult:
    """Descents from estimates, then the global search, which has their optima among its own."""
    generator = _generator(errors, settings)
    optima = descended(errors, starting_points(errors), FINAL_WIDTH)
    starts = np.array([optimum.point for optimum in optima]).reshape(-1, errors.dimension)
    spent = sum(optimum.evaluations for optimum in optima)
    if settings.evaluations == 0 and optima:
        return _without_generations([descend(errors, starts[0], POLISH_STEPS, POLISH_TOLERANCE)])
    problem = MultiInputProblem(errors, starts)
    known = optima[0].value if optima else np.inf
    found = global_search(problem, settings, generator, log, known, recombine=problem.recombine)
    if optima and known < found.value:
        best = descend(errors, starts[0], POLISH_STEPS, POLISH_TOLERANCE)
        found = replace(found, point=best.point, value=best.value)
    evaluations = found.diagnostics.evaluations + spent
    return replace(found, diagnostics=replace(found.diagnostics, evaluations=evaluations))


def _without_generations(optima: Sequence[Optimum]) -> SearchResult:
    """The lowest of some optima as the result of a search; nothing was confirmed."""
    spent = sum(optimum.evaluations for optimum in optima)
    value = optima[0].value
    diagnostics = SearchDiagnostics(
        evaluations=spent,
        generations=0,
        restart_minima=(value,),
        n_confirming=0,
        n_local_optima=len(optima),
        n_multistart=0,
        undiscovered_probability=1.0,
        convergence=((spent, value),),
    )
    return SearchResult(optima[0].point, value, diagnostics)


def _in_scaled_units(errors: MultiInputErrors, point: Array) -> MultiInputModel:
    """The model of a point, for the starts of other orders."""
    return errors.model(point, 1.0, 1.0)


def _bic(errors: MultiInputErrors, value: float) -> float:
    samples = errors.record.samples
    return float(errors.log_loss(value) + errors.parameters * np.log(samples) / samples)


def _described(
    errors: MultiInputErrors,
    result: SearchResult,
    sampling_rate: float,
    tangent: Array | None = None,
) -> MultiInputEstimate:
    """The model at a search's best point, with criteria, residuals and covariance."""
    record = errors.record
    residuals = errors.residuals(result.point)
    square = float(residuals @ residuals)
    variance = square / max(record.samples - errors.dimension, 1)
    model = errors.model(result.point, sampling_rate, variance)
    model = replace(
        model, covariance=parameter_covariance(errors, result.point, residuals, tangent)
    )
    value, samples = errors.percent(residuals), record.samples
    own = residuals[:, None] * record.output_scale
    if errors.objective == "absolute":
        own = limited(own)
    whitened = autoregression_of(own, record.bounds)
    parts = np.split(residuals * record.output_scale, record.bounds[1:-1])
    return MultiInputEstimate(
        model=model,
        objective=value,
        fit_percent=np.array([100.0 - 10.0 * np.sqrt(100.0 * square / samples)]),
        bic=_bic(errors, value),
        coloured_bic=float(whitened.bic + errors.parameters * np.log(samples) / samples),
        residuals=tuple(np.concatenate([np.full(record.start, np.nan), part]) for part in parts),
        at_stability_bound=lies_at_bound(errors.largest_radius(result.point), errors.radius),
        search=result,
    )
