"""Estimate polynomial models with several inputs and one output."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.constrained_model import equalities
from evopem.estimation.criteria import Criteria, lies_at_bound
from evopem.estimation.multi_input.constrained import (
    constrained_inputs,
    constrained_optimum,
)
from evopem.estimation.multi_input.descent import descend
from evopem.estimation.multi_input.errors import MultiInputErrors
from evopem.estimation.multi_input.problem import STEPS, TOLERANCE
from evopem.estimation.multi_input.records import record_for, records_of
from evopem.estimation.multi_input.search import (
    SETTINGS,
    WIDTH,
    descents,
    generator_of,
    in_scaled_units,
    searched,
    without_generations,
)
from evopem.estimation.pem.covariance import density_at_zero
from evopem.estimation.polynomial_estimate import ConstraintEffect, PolynomialEstimate
from evopem.estimation.search.problem import SearchResult
from evopem.estimation.vector_autoregression import (
    autoregression_of,
    coloured_autocovariances,
    limited,
)
from evopem.models.constraint_checks import check_constraints
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders, orders_of

# Eigenvalues of the information matrix, its diagonal scaled to one, below this share of the
# largest one come from rounding: the data do not determine their directions.
UNDETERMINED = 1e-14


def parameter_covariance(
    errors: MultiInputErrors, point: Array, residuals: Array, tangent: Array | None = None
) -> ParameterCovariance | None:
    """Covariance of ``[a, b_1 ... b_m, c, d, f_1 ... f_m, level]`` in the units of the record.

    ``H^-1 S H^-1`` with ``H = J'J``, states estimated along.  With a noise model the residuals are
    white and ``S = variance H``.  Without one they need not be: S then takes their
    autocovariances, independent of the inputs (Ljung 1999, eq. 9.42).  Of the absolute objective
    the signs of the residuals over twice their density at zero take the place of the residuals
    (Bassett & Koenker 1978).

    Parameters
    ----------
    errors : MultiInputErrors
    point : (n,) array
    residuals : (samples,) array
    tangent : (n, k) array, optional
        Directions of a point that active constraints leave free; by default all.

    Returns
    -------
    ParameterCovariance or None
        None where the density at zero cannot be estimated.
    """
    scores = residuals
    if errors.objective == "absolute":
        density = density_at_zero(residuals, errors.dimension)
        if not density > 0.0:
            return None
        scores = np.sign(residuals) / (2.0 * density)
    columns, mapping = errors.jacobian(point), _mapping(errors)
    if tangent is not None:
        columns, mapping = columns @ tangent, mapping @ tangent
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    columns = columns / size
    values, vectors = np.linalg.eigh(columns.T @ columns)
    kept = values > UNDETERMINED * values[-1]
    inverse = vectors[:, kept] / values[kept]
    middle = inverse.T @ _score_covariance(errors, columns, scores) @ inverse
    square, turned = np.linalg.eigh(0.5 * (middle + middle.T))
    mapping = mapping / size
    root = turned * np.sqrt(np.maximum(square, 0.0))
    return ParameterCovariance(mapping @ (vectors[:, kept] @ root), mapping @ vectors[:, ~kept])


def _score_covariance(errors: MultiInputErrors, columns: Array, residuals: Array) -> Array:
    o, record = errors.orders, errors.record
    degrees = max(record.samples - errors.dimension, 1)
    inflation = record.samples / degrees
    if o.na or o.noise_states:
        variance = float(residuals @ residuals) / degrees
        return np.asarray(variance * (columns.T @ columns))
    total = np.zeros((columns.shape[1],) * 2)
    for lag, gamma in enumerate(coloured_autocovariances(residuals[:, None], record.bounds)):
        for first, stop in zip(record.bounds[:-1], record.bounds[1:], strict=True):
            if first + lag >= stop:
                continue
            products = columns[first + lag : stop].T @ columns[first : stop - lag]
            total += float(gamma[0, 0]) * (products if lag == 0 else products + products.T)
    return np.asarray(inflation * total)


def _mapping(errors: MultiInputErrors) -> Array:
    """Derivatives of coefficients and level, in their units, by a point; level of all records."""
    o, record = errors.orders, errors.record
    mapping = np.zeros((errors.parameters, errors.dimension))
    coefficients = np.arange(o.parameters)
    mapping[coefficients, coefficients] = errors.units[:-1]
    own = (errors.dimension - o.parameters) // len(record.outputs)
    places = o.parameters + own * np.arange(len(record.outputs))
    mapping[-1, places] = record.output_scale * np.diff(record.bounds) / record.samples
    mapping[-1, o.part("a")] = record.offset
    return mapping


Array = NDArray[np.float64]
Log = Callable[[str], None]

# Last number of the key of the draws under constraints.
CONSTRAINED = 1


def estimate_multi_input(
    inputs: ArrayLike | Sequence[ArrayLike],
    output: ArrayLike | Sequence[ArrayLike],
    orders: Orders | Mapping[str, Any] | Sequence[Any],
    structure: str = "armax",
    sampling_rate: float = 1.0,
    *,
    settings: SearchSettings | None = None,
    constraints: Constraints | None = None,
    input_names: Sequence[str] = (),
    output_name: str = "",
    log: Log | None = None,
) -> PolynomialEstimate:
    """Find the model of some orders with the smallest sum of squared, or absolute, one-step errors.

    Parameters
    ----------
    inputs : (N, nu) array_like, or a list of them
        One record or several; not modified.
    output : (N,) or (N, 1) array_like, or a list of them
    orders : Orders, mapping or sequence
        Of nb, nf and nk one number for all inputs, or a list with one for each.
    structure : str
        ``fir``, ``arx``, ``armax``, ``ararx``, ``ararmax``, ``oe``, ``bj`` or ``general``.
    sampling_rate : float
        Hz.
    settings : SearchSettings, optional
        :data:`.SETTINGS`, with the quadratic objective, by default.  The draws come from
        ``SeedSequence(seed, spawn_key=...)`` of the orders.
    constraints : Constraints, optional
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
    us, ys = records_of(inputs, output)
    wanted = orders_of(structure, orders, us[0].shape[1])
    names = tuple(input_names) or tuple(str(k + 1) for k in range(wanted.inputs))
    if constraints is not None:
        check_constraints(constraints, wanted, sampling_rate, names)
    with one_blas_thread():
        record = record_for(us, ys, wanted)
        errors = MultiInputErrors(record, wanted, settings.max_root_radius, settings.objective)
        found = searched(errors, settings, log)
        if constraints is None:
            estimate = _described(errors, found, sampling_rate)
        else:
            parameters = constrained_inputs(constraints, errors, names, sampling_rate)
            generator = generator_of(errors, settings, CONSTRAINED)
            best = constrained_optimum(errors, parameters, found, generator)
            estimate = _described(errors, best.result, sampling_rate, best.tangent)
            effect = ConstraintEffect(
                best.result.value, found.value, (*equalities(constraints), *best.active)
            )
            estimate = replace(estimate, constraints=effect)
    model = replace(estimate.model, input_names=tuple(input_names), output_name=output_name)
    return replace(estimate, model=model)


def multi_input_estimates(
    inputs: ArrayLike | Sequence[ArrayLike],
    output: ArrayLike | Sequence[ArrayLike],
    orders: Mapping[int, Orders],
    settings: SearchSettings | None = None,
    log: Log | None = None,
) -> Iterator[tuple[int, PolynomialEstimate]]:
    """Estimates of ascending orders, each from linear estimates and from smaller models.

    All are scored on the same samples.  The sampling rate is 1 Hz.

    Parameters
    ----------
    inputs, output
        As of :func:`estimate_multi_input`.
    orders : mapping of int to Orders
        Ascending, by the joint order that they follow.
    settings : SearchSettings, optional
    log : callable, optional
    """
    settings = settings or SETTINGS
    us, ys = records_of(inputs, output)
    largest = orders[max(orders)]
    record = record_for(us, ys, largest)
    smaller: list[PolynomialModel] = []
    for order, wanted in orders.items():
        errors = MultiInputErrors(record, wanted, settings.max_root_radius, settings.objective)
        with one_blas_thread():
            found = descents(errors, smaller[-2:], settings, WIDTH)
            if not found:
                continue
            estimate = _described(errors, without_generations(found), 1.0)
        smaller.append(in_scaled_units(errors, found[0].point))
        if log is not None:
            log(f"{wanted}: {estimate.objective:.9g} %")
        yield order, estimate


def refitted_multi_input(
    model: PolynomialModel,
    inputs: Sequence[ArrayLike],
    outputs: Sequence[ArrayLike],
    settings: SearchSettings,
) -> PolynomialModel:
    """The optimum of other records that a descent from a model ends at.

    Of the settings the objective and the largest radius of roots are used.

    Raises
    ------
    ValueError
        When the records are too short, or no errors are finite.
    """
    us, ys = records_of(inputs, outputs)
    with one_blas_thread():
        record = record_for(us, ys, model.orders)
        errors = MultiInputErrors(
            record, model.orders, settings.max_root_radius, settings.objective
        )
        found = descend(errors, errors.point_of(model), STEPS, TOLERANCE)
        if not np.isfinite(found.value):
            raise ValueError("the descent found no finite errors")
        variance = float(np.mean(errors.residuals(found.point) ** 2))
        return errors.model(found.point, model.sampling_rate, variance)


def _described(
    errors: MultiInputErrors,
    result: SearchResult,
    sampling_rate: float,
    tangent: Array | None = None,
) -> PolynomialEstimate:
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
    whitened = autoregression_of(
        limited(own) if errors.objective == "absolute" else own, record.bounds
    )
    missing = np.full(record.start, np.nan)
    parts = np.split(own[:, 0], record.bounds[1:-1])
    levels, plant, noise = errors.own_parts(result.point)
    return PolynomialEstimate(
        model=model,
        criteria=Criteria(
            value,
            100.0 - 10.0 * float(np.sqrt(100.0 * square / samples)),
            100.0 * square / samples,
            errors.bic(value),
        ),
        residuals=np.concatenate([part for each in parts for part in (missing, each)]),
        plant_state=plant,
        noise_state=noise,
        window=ScoringWindow(record.start, record.start),
        at_stability_bound=lies_at_bound(errors.largest_radius(result.point), errors.radius),
        search=result,
        focus_objective=value,
        levels=levels,
        coloured_bic=float(whitened.bic + errors.parameters * np.log(samples) / samples),
    )
