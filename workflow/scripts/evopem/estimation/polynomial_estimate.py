"""Estimate one general polynomial model from a record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from evopem.estimation.pem.covariance import innovation_variance, parameter_covariance
from evopem.estimation.pem.objective import OBJECTIVES
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.search.memetic import SearchResult, SearchSettings, hybrid_search
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import max_root_radius
from evopem.models.structures import PolynomialOrders, orders_of

Array = NDArray[np.float64]

DEFAULT_MAX_ROOT_RADIUS = 0.9999
# A root this close to the largest allowed radius, relative to the room left outside it, lies at it.
BOUND_WIDTH = 0.05


@dataclass(frozen=True, eq=False)
class PolynomialEstimate:
    """An estimated polynomial model, its criteria and the diagnostics of its search.

    Attributes
    ----------
    model : PolynomialModel
    objective : str
        ``absolute`` or ``quadratic``.
    objective_value : float
        In percent; ``search.value`` has the weak squares of the states added.
    fit_percent : float
        ``100 (1 - sum|e| / sum|y|)``.
    rss : float
        ``100 ||e||^2 / ||y||^2`` in percent.
    bic : float
        ``ln(||e||^2 / N) + n ln(N) / N`` over the residuals that count, n the coefficients and
        the level.
    residuals : (N,) array
        NaN before ``residual_start``.
    plant_state : (nf,) array
        What the past adds to the first equations of ``F x = -B u``.
    noise_state : (max(nc, nd),) array
        What the past adds to the first equations of ``C e = D v``.
    residual_start, loss_start : int
        First residual, and the first one that counts.
    at_stability_bound : bool
        Whether a root of A, C, D or F lies at the largest radius allowed.
    search : SearchResult
    """

    model: PolynomialModel
    objective: str
    objective_value: float
    fit_percent: float
    rss: float
    bic: float
    residuals: Array = field(repr=False)
    plant_state: Array = field(repr=False)
    noise_state: Array = field(repr=False)
    residual_start: int
    loss_start: int
    at_stability_bound: bool
    search: SearchResult = field(repr=False)


def estimate_polynomial(
    input: ArrayLike | None,  # noqa: A002 - the field's word
    output: ArrayLike,
    structure: str,
    orders: PolynomialOrders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    objective: str = "quadratic",
    level: bool = False,
    seed: int = 1,
    residual_start: int | None = None,
    loss_start: int | None = None,
    plant_radius: float = DEFAULT_MAX_ROOT_RADIUS,
    noise_radius: float = DEFAULT_MAX_ROOT_RADIUS,
    search: SearchSettings | None = None,
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
    objective : {"quadratic", "absolute"}
        Sum of the squares of the prediction errors or of their absolute values.
    level : bool
        Whether a constant is estimated: ``A y = (B/F) u + (C/D) e + level``.
    seed : int
        The search draws from ``SeedSequence(seed, spawn_key=(na, nb, nc, nd, nf, nk, level))``.
    residual_start : int, optional
        First residual; by default the first whose past inputs and outputs are measured.
    loss_start : int, optional
        First residual that counts; by default the first residual, since the states of all filters
        are estimated.
    plant_radius, noise_radius : float
        Largest radius of the roots of A and F, and of those of C and D.
    search : SearchSettings, optional
    log : callable, optional
        Receives one line a generation.

    Raises
    ------
    ValueError
        When the record cannot carry the orders, or a setting is not what it must be.
    """
    o = orders_of(structure, orders)
    y = np.ascontiguousarray(output, dtype=float)
    if input is None and o.nb:
        raise ValueError(f"structure {structure!r} with nb = {o.nb} needs an input")
    u = np.zeros_like(y) if input is None else np.ascontiguousarray(input, dtype=float)
    first = o.first_residual if residual_start is None else residual_start
    counted = first if loss_start is None else loss_start
    _check(u, y, o, objective, first, counted, (plant_radius, noise_radius))
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with threadpool_limits(limits=1, user_api="blas"):
        errors = PolynomialErrors(
            u, y, o, objective, first, counted, plant_radius, noise_radius, level
        )
        problem, scales = _of_moderate_size(errors)
        key = (o.na, o.nb, o.nc, o.nd, o.nf, o.nk, int(level))
        generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
        found = hybrid_search(problem, search or SearchSettings(), generator, log)
        found = replace(found, point=found.point * scales)
        return _described(errors, found, structure, sampling_rate)


def _of_moderate_size(errors: PolynomialErrors) -> tuple[PolynomialProblem, Array]:
    """The problem with signals of moderate size, and the factors that scale its points back.

    Powers of two leave every bit of signals and points as it is.
    """
    input_scale, output_scale = _power_of_two(errors.input), _power_of_two(errors.output)
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


def _power_of_two(signal: Array) -> float:
    """The power of two next below a signal's largest magnitude; 1 for a signal of zeros."""
    largest = float(np.max(np.abs(signal)))
    return 2.0 ** np.floor(np.log2(largest)) if largest > 0.0 else 1.0


def _check(
    u: Array,
    y: Array,
    orders: PolynomialOrders,
    objective: str,
    residual_start: int,
    loss_start: int,
    radii: tuple[float, float],
) -> None:
    if u.ndim != 1 or u.shape != y.shape:
        raise ValueError(f"input and output must be of one length, not {u.shape} and {y.shape}")
    if not (np.isfinite(u).all() and np.isfinite(y).all()):
        raise ValueError("input and output must be finite")
    if objective not in OBJECTIVES:
        raise ValueError(f"objective must be one of {OBJECTIVES}, not {objective!r}")
    for name, radius in zip(("plant_radius", "noise_radius"), radii, strict=True):
        if not 0.0 < radius < 1.0:
            raise ValueError(f"{name} must lie between 0 and 1, not {radius}")
    if residual_start < orders.first_residual:
        raise ValueError(f"{orders} has no residual before sample {orders.first_residual}")
    if loss_start < residual_start:
        raise ValueError(f"the loss starts at {loss_start}, before the first residual")
    estimated = orders.parameters + orders.nf + orders.noise_states
    if len(y) - loss_start <= estimated:
        raise ValueError(
            f"{orders} needs more than {estimated} residuals for its coefficients and initial "
            f"states; {len(y)} samples less the first {loss_start} leave {len(y) - loss_start}"
        )
    if not np.any(y[loss_start:]):
        raise ValueError("the output is zero throughout")


def _described(
    errors: PolynomialErrors, result: SearchResult, structure: str, sampling_rate: float
) -> PolynomialEstimate:
    """The model at a search's best point, with its criteria, residuals and covariance."""
    point, parts = result.point, errors.parts()
    a, c, d, f = (np.concatenate([[1.0], point[parts[name]]]) for name in "acdf")
    residuals = errors.residuals(point)
    counted, counted_output = residuals[errors.loss_start :], errors.output[errors.loss_start :]
    square_sum, count, n = float(counted @ counted), len(counted), errors.parameters
    rss = 100.0 * square_sum / float(counted_output @ counted_output)
    absolute = 100.0 * float(np.sum(np.abs(counted)) / np.sum(np.abs(counted_output)))
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
        covariance=parameter_covariance(triangle, counted, coefficients, errors.objective),
        structure=structure,
    )
    residuals[: errors.residual_start] = np.nan
    at_bound = (
        _lies_at(max(max_root_radius(a[1:]), max_root_radius(f[1:])), errors.plant_radius),
        _lies_at(max(max_root_radius(c[1:]), max_root_radius(d[1:])), errors.noise_radius),
    )
    return PolynomialEstimate(
        model=model,
        objective=errors.objective,
        objective_value=rss if errors.objective == "quadratic" else absolute,
        fit_percent=100.0 - absolute,
        rss=rss,
        bic=float(np.log(square_sum / count) + n * np.log(count) / count),
        residuals=residuals,
        plant_state=point[parts["plant"]].copy(),
        noise_state=point[parts["noise"]].copy(),
        residual_start=errors.residual_start,
        loss_start=errors.loss_start,
        at_stability_bound=any(at_bound),
        search=result,
    )


def _lies_at(radius: float, bound: float) -> bool:
    return bool(1.0 - radius <= (1.0 + BOUND_WIDTH) * (1.0 - bound))
