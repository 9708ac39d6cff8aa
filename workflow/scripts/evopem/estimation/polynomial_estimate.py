"""Estimate one general polynomial model from a record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.criteria import (
    Criteria,
    criteria_of,
    lies_at_bound,
    power_of_two_scale,
)
from evopem.estimation.pem.covariance import estimate_covariance, innovation_variance
from evopem.estimation.pem.objective import OBJECTIVES
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.search.armax_problem import INITIALIZATIONS
from evopem.estimation.search.memetic import REFINE, memetic_search
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchResult
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import max_root_radius
from evopem.models.structures import PolynomialOrders, orders_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PolynomialEstimate:
    """An estimated polynomial model, its criteria, and the search that found it.

    Attributes
    ----------
    model : PolynomialModel
        With the covariance of its coefficients.
    criteria : Criteria
    residuals : (N,) array
        NaN before ``window.residual_start``.
    plant_state : (nf,) array
        Contribution of the past to the first equations of ``F x = -B u``.
    noise_state : (max(nc, nd),) array
        Contribution of the past to the first equations of ``C e = D v``.
    window : ScoringWindow
    at_stability_bound : bool
        Whether a root of A, C, D or F lies at the largest radius allowed.
    search : SearchResult
        ``search.value`` is the objective plus the priors of the states.
    """

    model: PolynomialModel
    criteria: Criteria
    residuals: Array = field(repr=False)
    plant_state: Array = field(repr=False)
    noise_state: Array = field(repr=False)
    window: ScoringWindow
    at_stability_bound: bool
    search: SearchResult = field(repr=False)


def estimate_polynomial(
    input: ArrayLike | None,  # noqa: A002 - the field's word
    output: ArrayLike,
    structure: str,
    orders: PolynomialOrders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    log: Callable[[str], None] | None = None,
) -> PolynomialEstimate:
    """Find the polynomial model of given orders with the smallest prediction errors, globally.

    Parameters
    ----------
    input, output : (N,) array_like
        The record; not modified.  ``input`` is None for a model without input.
    structure : str
        ``fir``, ``arx``, ``arma``, ``armax``, ``ararx``, ``ararmax``, ``oe``, ``bj`` or
        ``general``.
    orders : PolynomialOrders, mapping or sequence
        ``{"nb": 4, "nf": 4, "nk": 1}``, or MATLAB's tuple for the structure, here (4, 4, 1).
    sampling_rate : float
        Hz.
    settings : SearchSettings, optional
        Objective, seed, bounds and size of the search.  Its draws come from
        ``SeedSequence(seed, spawn_key=(na, nb, nc, nd, nf, nk, level))``.  ``initialization`` and
        ``n_initial_discard`` are not used: the first population holds estimates of several kinds,
        and the initial states of all filters are estimated.
    window : ScoringWindow, optional
        By default the first residual is the first whose past inputs and outputs are measured, and
        all residuals count.
    level : bool
        Whether a constant is estimated: ``A y = (B/F) u + (C/D) e + level``.
    log : callable, optional
        Receives one line a generation.

    Raises
    ------
    ValueError
        When the record is too short for the orders, or a setting is outside its range.
    """
    o = orders_of(structure, orders)
    settings = settings or SearchSettings()
    y = np.ascontiguousarray(output, dtype=float)
    if input is None and o.nb:
        raise ValueError(f"structure {structure!r} with nb = {o.nb} needs an input")
    u = np.zeros_like(y) if input is None else np.ascontiguousarray(input, dtype=float)
    window = window or ScoringWindow(o.first_residual, o.first_residual)
    _check(u, y, o, settings, window)
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with threadpool_limits(limits=1, user_api="blas"):
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
        problem, scales = _scaled_problem(errors)
        key = (o.na, o.nb, o.nc, o.nd, o.nf, o.nk, int(level))
        sequence = np.random.SeedSequence(settings.seed, spawn_key=key)
        generator = np.random.default_rng(sequence)
        found = memetic_search(problem, settings, generator, log, recombine=problem.recombine)
        found = replace(found, point=found.point * scales)
        return _described(errors, found, structure, sampling_rate)


def _scaled_problem(errors: PolynomialErrors) -> tuple[PolynomialProblem, Array]:
    """The problem with signals scaled to moderate size, and the scales of its parameters."""
    input_scale, output_scale = power_of_two_scale(errors.input), power_of_two_scale(errors.output)
    scaled = PolynomialErrors(
        errors.input / input_scale,
        errors.output / output_scale,
        errors.orders,
        errors.objective,
        errors.residual_start,
        errors.loss_start,
        errors.plant_radius,
        errors.noise_radius,
        errors.level,
    )
    scales = np.ones(errors.dimension)
    parts = errors.parts()
    scales[parts["b"]] = output_scale / input_scale
    for name in ("level", "plant", "noise"):
        scales[parts[name]] = output_scale
    return PolynomialProblem(scaled), scales


def _check(
    u: Array, y: Array, orders: PolynomialOrders, settings: SearchSettings, window: ScoringWindow
) -> None:
    if u.ndim != 1 or u.shape != y.shape:
        raise ValueError(f"input and output must be of one length, not {u.shape} and {y.shape}")
    if not (np.isfinite(u).all() and np.isfinite(y).all()):
        raise ValueError("input and output must be finite")
    for name, known in (
        ("objective", OBJECTIVES),
        ("refine", REFINE),
        ("initialization", INITIALIZATIONS),
    ):
        value = getattr(settings, name)
        if value not in known:
            raise ValueError(f"{name} must be one of {known}, not {value!r}")
    if not 0.0 < settings.max_root_radius < 1.0:
        raise ValueError(
            f"max_root_radius must lie between 0 and 1, not {settings.max_root_radius}"
        )
    if window.residual_start < orders.first_residual:
        raise ValueError(f"{orders} has no residual before sample {orders.first_residual}")
    if window.loss_start < window.residual_start:
        raise ValueError(f"the loss starts at {window.loss_start}, before the first residual")
    estimated = orders.parameters + orders.nf + orders.noise_states
    counted = len(y) - window.loss_start
    if counted <= estimated:
        raise ValueError(
            f"{orders} needs more than {estimated} residuals for its coefficients and initial "
            f"states; {len(y)} samples less the first {window.loss_start} leave {counted}"
        )
    if not np.any(y[window.loss_start :]):
        raise ValueError("the output is zero throughout")


def _described(
    errors: PolynomialErrors, result: SearchResult, structure: str, sampling_rate: float
) -> PolynomialEstimate:
    """The model at a search's best point, with its criteria, residuals and covariance."""
    point, parts = result.point, errors.parts()
    a, c, d, f = (np.concatenate([[1.0], point[parts[name]]]) for name in "acdf")
    residuals = errors.residuals(point)
    counted, counted_output = residuals[errors.loss_start :], errors.output[errors.loss_start :]
    triangle = np.asarray(np.linalg.qr(errors.jacobian(point), mode="r"))
    coefficients = errors.orders.parameters
    model = PolynomialModel(
        a,
        point[parts["b"]].copy(),
        c,
        d,
        f,
        errors.orders.nk,
        sampling_rate,
        level=float(point[parts["level"]].sum()),
        noise_variance=innovation_variance(counted, errors.dimension),
        covariance=estimate_covariance(
            triangle, counted, counted_output, coefficients, 0, errors.objective
        ),
        structure=structure,
    )
    residuals[: errors.residual_start] = np.nan
    at_bound = (
        lies_at_bound(max(max_root_radius(a[1:]), max_root_radius(f[1:])), errors.plant_radius),
        lies_at_bound(max(max_root_radius(c[1:]), max_root_radius(d[1:])), errors.noise_radius),
    )
    return PolynomialEstimate(
        model=model,
        criteria=criteria_of(counted, counted_output, errors.objective, errors.parameters),
        residuals=residuals,
        plant_state=point[parts["plant"]].copy(),
        noise_state=point[parts["noise"]].copy(),
        window=ScoringWindow(errors.residual_start, errors.loss_start),
        at_stability_bound=any(at_bound),
        search=result,
    )
