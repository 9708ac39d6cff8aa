"""Estimate one ARMAX model from a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from evopem.estimation.pem.covariance import (
    estimate_covariance,
    innovation_variance,
    jacobian_triangle,
)
from evopem.estimation.pem.kernels import MIN_NC
from evopem.estimation.pem.minimum_norm import minimum_norm_point
from evopem.estimation.pem.objective import OBJECTIVES, PredictionErrorProblem
from evopem.estimation.search.armax_problem import STARTS, ArmaxProblem
from evopem.estimation.search.memetic import (
    MUTATE,
    SearchResult,
    SearchSettings,
    hybrid_search,
    pooled,
)
from evopem.models.armax import ArmaxModel, Orders
from evopem.models.polynomials import max_root_radius as largest_radius

Array = NDArray[np.float64]

DEFAULT_BURN_IN = 20
DEFAULT_MAX_ROOT_RADIUS = 0.9999
# A root this close to the largest allowed radius, relative to the room left outside it, lies at it.
MARGIN_WIDTH = 0.05


@dataclass(frozen=True, eq=False)
class Estimate:
    """An estimated model and the evidence for it.

    Attributes
    ----------
    model : ArmaxModel
    objective : str
        ``absolute`` or ``quadratic``.
    objective_value : float
        In percent (chapter eq. 20 or 22); ``search.value`` has the square of the noise state added
        (:data:`evopem.estimation.pem.objective.STATE_WEIGHT`).
    fit_percent : float
        ``100 (1 - sum|e| / sum|y|)`` (chapter eq. 21).
    rss : float
        ``100 ||e||^2 / ||y||^2`` in percent (chapter eq. 22).
    bic : float
        ``ln(||e||^2 / N) + n ln(N) / N`` over the scored samples (chapter eq. 23).
    residuals : (N,) array
        NaN before the recursion starts.
    noise_state : (nc,) array
        What the noise before ``recursion_start`` adds to the first equation errors.
    recursion_start : int
        First residual.
    scoring_start : int
        First residual that counts in all of the above.
    at_margin : bool
        Whether a root of A or C lies at the largest radius allowed.
    search : SearchResult
    """

    model: ArmaxModel
    objective: str
    objective_value: float
    fit_percent: float
    rss: float
    bic: float
    residuals: Array = field(repr=False)
    noise_state: Array = field(repr=False)
    recursion_start: int
    scoring_start: int
    at_margin: bool
    search: SearchResult = field(repr=False)


def estimate(
    input: ArrayLike,  # noqa: A002
    output: ArrayLike,
    orders: Orders | tuple[int, int, int, int],
    sampling_rate: float = 1.0,
    *,
    objective: str = "absolute",
    seed: int = 1,
    recursion_start: int | None = None,
    scoring_start: int | None = None,
    max_root_radius: float = DEFAULT_MAX_ROOT_RADIUS,
    search: SearchSettings | None = None,
    start: str = "chapter",
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
) -> Estimate:
    """Find the ARMAX model of given orders with the smallest prediction errors, globally.

    Parameters
    ----------
    input, output : (N,) array_like
        The record; not modified.  Constant parts should have been removed.
    orders : Orders or (na, nb, nc, nk)
        ``nb`` counts B's coefficients, the first at lag ``nk``.
    sampling_rate : float
        Hz.
    objective : {"absolute", "quadratic"}
        Sum of absolute prediction errors (chapter eq. 20-21) or of their squares.
    seed : int
        The search draws from ``SeedSequence(seed, spawn_key=orders)``, with a 1 appended to the
        key when it goes on from an earlier one.
    recursion_start : int, optional
        First residual; by default ``orders.first_residual``.
    scoring_start : int, optional
        First residual that counts; by default 20 (or nc) after the first.  Models of different
        order that are to be compared need one ``recursion_start`` and one ``scoring_start``.
    max_root_radius : float
        Largest radius of the roots of A and C.
    search : SearchSettings, optional
    start : {"chapter", "grown"}
        First individuals: A and B of stage one with C at random, as in the chapter, or grown from
        smaller orders by pairs of roots, which often ends lower where the model has too many.
    earlier : SearchResult, optional
        The result of an earlier search of the same problem, to be pooled with this one.
    log : callable, optional
        Receives one line a generation.

    Returns
    -------
    Estimate

    Raises
    ------
    ValueError
        When the record cannot carry the orders, or a setting is not what it must be.
    """
    orders = orders if isinstance(orders, Orders) else Orders(*orders)
    search = search or SearchSettings()
    u = np.ascontiguousarray(input, dtype=float)
    y = np.ascontiguousarray(output, dtype=float)
    first = orders.first_residual if recursion_start is None else recursion_start
    burnt_in = first + max(DEFAULT_BURN_IN, orders.nc)
    scored_from = burnt_in if scoring_start is None else scoring_start
    _check(u, y, orders, objective, (first, scored_from), max_root_radius, search, start)
    # What the kernels look back on.
    first, scored_from = max(first, MIN_NC), max(scored_from, MIN_NC)
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with threadpool_limits(limits=1, user_api="blas"):
        errors = PredictionErrorProblem(
            u, y, orders, objective, first, scored_from, max_root_radius
        )
        problem, scales = _of_moderate_size(errors, start)
        key = (orders.na, orders.nb, orders.nc, orders.nk, *((1,) if earlier else ()))
        sequence = np.random.SeedSequence(seed, spawn_key=key)
        known = earlier.value if earlier is not None else np.inf
        result = hybrid_search(problem, search, np.random.default_rng(sequence), log, known)
        result = replace(result, point=result.point * scales)
        if earlier is not None:
            result = pooled(earlier, result)
        return describe(errors, result, sampling_rate)


def descend_from(
    point: ArrayLike, errors: PredictionErrorProblem, sampling_rate: float, earlier: SearchResult
) -> Estimate:
    """One descent from a point, pooled with an earlier search of the same problem.

    Parameters
    ----------
    point : (n,) array_like
        Parameters and noise state, in the problem's own units.
    errors : PredictionErrorProblem
    sampling_rate : float
        Hz.
    earlier : SearchResult
    """
    problem, scales = _of_moderate_size(errors, "chapter")
    polished = problem.polish(np.asarray(point)[None, :] / scales)
    value, used = float(polished.values[0]), polished.evaluations
    ended = SearchResult(
        point=polished.points[0] * scales,
        value=value,
        evaluations=used,
        generations=0,
        ends=(value,),
        basins=1,
        checked=0,
        unseen=1.0,
        convergence=((used, value),),
    )
    return describe(errors, pooled(earlier, ended), sampling_rate)


def _of_moderate_size(errors: PredictionErrorProblem, start: str) -> tuple[ArmaxProblem, Array]:
    """The problem with signals of moderate size, and what takes its points back.

    Powers of two leave every bit of signals and points alone.
    """
    u, y, orders = errors.input, errors.output, errors.orders
    input_scale, output_scale = _power_of_two(u), _power_of_two(y)
    scaled = PredictionErrorProblem(
        u / input_scale,
        y / output_scale,
        orders,
        errors.objective,
        errors.recursion_start,
        errors.scoring_start,
        errors.max_root_radius,
    )
    scales = np.ones(errors.dimension)
    scales[orders.na : orders.na + orders.nb] = output_scale / input_scale
    scales[orders.parameters :] = output_scale
    return ArmaxProblem(scaled, start), scales


def _power_of_two(signal: Array) -> float:
    """The power of two next below a signal's largest magnitude; 1 for a signal of zeros."""
    largest = float(np.max(np.abs(signal)))
    return 2.0 ** np.floor(np.log2(largest)) if largest > 0.0 else 1.0


def _check(
    u: Array,
    y: Array,
    orders: Orders,
    objective: str,
    starts: tuple[int, int],
    max_root_radius: float,
    search: SearchSettings,
    start: str,
) -> None:
    if u.ndim != 1 or u.shape != y.shape:
        raise ValueError(f"input and output must be of one length, not {u.shape} and {y.shape}")
    if not (np.isfinite(u).all() and np.isfinite(y).all()):
        raise ValueError("input and output must be finite")
    if objective not in OBJECTIVES:
        raise ValueError(f"objective must be one of {OBJECTIVES}, not {objective!r}")
    if search.mutate not in MUTATE:
        raise ValueError(f"mutate must be one of {MUTATE}, not {search.mutate!r}")
    if start not in STARTS:
        raise ValueError(f"start must be one of {STARTS}, not {start!r}")
    if not 0.0 < max_root_radius < 1.0:
        raise ValueError(f"max_root_radius must lie between 0 and 1, not {max_root_radius}")
    recursion_start, scoring_start = starts
    if recursion_start < orders.first_residual:
        raise ValueError(f"{orders} has no residual before sample {orders.first_residual}")
    if scoring_start < recursion_start:
        raise ValueError(f"scoring starts at {scoring_start}, before the first residual")
    if len(y) - scoring_start <= orders.parameters:
        raise ValueError(
            f"{orders} has {orders.parameters} parameters and needs more scored samples than "
            f"that; {len(y)} samples less the first {scoring_start} leave {len(y) - scoring_start}"
        )
    if not np.any(y[scoring_start:]):
        raise ValueError("the output is zero throughout")


def describe(
    errors: PredictionErrorProblem, result: SearchResult, sampling_rate: float
) -> Estimate:
    """The model at a search's best point, with its criteria, residuals and covariance."""
    orders, start = errors.orders, errors.scoring_start
    point, residuals, triangle = _identifiable(errors, result.point)
    a, b, c = _coefficients(point, orders)
    scored, scored_output = residuals[start:], errors.output[start:]
    square_sum, count, n = float(scored @ scored), len(scored), orders.parameters
    rss = 100.0 * square_sum / float(scored_output @ scored_output)
    absolute = 100.0 * float(np.sum(np.abs(scored)) / np.sum(np.abs(scored_output)))
    model = ArmaxModel(
        a,
        b,
        c,
        orders.nk,
        sampling_rate,
        noise_variance=innovation_variance(scored, triangle.shape[1]),
        covariance=estimate_covariance(
            triangle, scored, scored_output, n, orders.nc, errors.objective
        ),
    )
    residuals[: errors.recursion_start] = np.nan
    radius = max(largest_radius(a[1:]), largest_radius(c[1:]))
    return Estimate(
        model=model,
        objective=errors.objective,
        objective_value=rss if errors.objective == "quadratic" else absolute,
        fit_percent=100.0 - absolute,
        rss=rss,
        bic=float(np.log(square_sum / count) + n * np.log(count) / count),
        residuals=residuals,
        noise_state=point[orders.parameters :].copy(),
        recursion_start=errors.recursion_start,
        scoring_start=start,
        at_margin=bool(1.0 - radius <= (1.0 + MARGIN_WIDTH) * (1.0 - errors.max_root_radius)),
        search=result,
    )


def _identifiable(errors: PredictionErrorProblem, point: Array) -> tuple[Array, Array, Array]:
    """The point with the shortest B of equal residuals, its residuals and Jacobian triangle."""
    residuals, triangle = _residuals_and_triangle(errors, point)
    shortest = minimum_norm_point(point, triangle, errors.orders)
    if np.array_equal(shortest, point):
        return point, residuals, triangle
    return shortest, *_residuals_and_triangle(errors, shortest)


def _residuals_and_triangle(errors: PredictionErrorProblem, point: Array) -> tuple[Array, Array]:
    residuals = errors.residuals(point)
    bare = ArmaxModel(*_coefficients(point, errors.orders), errors.orders.nk)
    triangle = jacobian_triangle(
        bare, errors.input, errors.output, residuals, errors.recursion_start, errors.scoring_start
    )
    return residuals, triangle


def _coefficients(point: Array, orders: Orders) -> tuple[Array, Array, Array]:
    """A, B and C of a point."""
    a, b, c = np.split(point[: orders.parameters], [orders.na, orders.na + orders.nb])
    return np.concatenate([[1.0], a]), b.copy(), np.concatenate([[1.0], c])
