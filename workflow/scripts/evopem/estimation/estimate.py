"""Estimate one ARMAX model from a record."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.criteria import criteria_of, lies_at_bound, power_of_two_scale
from evopem.estimation.pem.covariance import (
    estimate_covariance,
    innovation_variance,
    jacobian_triangle,
    pseudo_inverse_factor,
)
from evopem.estimation.pem.kernels import MIN_NC
from evopem.estimation.pem.objective import PredictionErrorProblem
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.estimation.requirements import check_search_settings, check_signals, check_window
from evopem.estimation.search.armax_problem import ArmaxProblem
from evopem.estimation.search.global_search import continued_search
from evopem.estimation.search.likely_gain import Aim
from evopem.estimation.search.problem import SearchResult, descended, pooled
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import max_root_radius as largest_radius
from evopem.models.structures import Orders, armax_orders
from evopem.signals.recording import real_signal
from evopem.signals.recording_checks import LARGEST


def minimum_norm_point(point: Array, triangle: Array, orders: Orders) -> Array:
    """The point with the smallest ||b|| among those of equal residuals with the same A and C.

    The residuals are linear in B and the noise state, given A and C.  Along the null space of
    that part of the Jacobian they do not change, so an input that excites fewer directions than
    B has coefficients leaves B undetermined; the search may end anywhere there.

    Parameters
    ----------
    point : (n + nc,) array
        Parameters and noise state.
    triangle : (m, n + nc) array
        Of :func:`.covariance.jacobian_triangle` at the point.
    orders : Orders

    Returns
    -------
    (n + nc,) array
        A new array; equal to the point where the data determine B.
    """
    of_b = slice(orders.na, orders.na + orders.single.nb)
    linear = np.r_[of_b, orders.parameters : len(point)]
    _, null_space = pseudo_inverse_factor(triangle[:, linear])
    shortest = point.copy()
    if not np.any(null_space[: orders.single.nb]):
        return shortest
    weights = np.linalg.lstsq(null_space[: orders.single.nb], -point[of_b], rcond=None)[0]
    shortest[linear] += null_space @ weights
    return shortest


Array = NDArray[np.float64]


def estimate(
    input: ArrayLike,  # noqa: A002
    output: ArrayLike,
    orders: Orders | tuple[int, int, int, int],
    sampling_rate: float = 1.0,
    *,
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
    aim: Aim | None = None,
) -> PolynomialEstimate:
    """Find the ARMAX model of given orders with the smallest prediction errors, globally.

    Parameters
    ----------
    input, output : (N,) array_like
        The record; not modified.  Constant parts should have been removed.
    orders : Orders or (na, nb, nc, nk)
        ``nb`` is the number of coefficients of B, the first at lag ``nk``.
    sampling_rate : float
        Hz.
    settings : SearchSettings, optional
        Objective, seed, bounds and size of the search.  Its draws come from
        ``SeedSequence(seed, spawn_key=orders)``, with the number of its restarts appended to
        the key when the search continues an earlier one.
    window : ScoringWindow, optional
        By default the first residual is the first that has all its measured past and at least nc
        before it, and the loss leaves out the
        first ``settings.n_initial_discard`` residuals, at least nc.  Models of different orders
        that are to be compared need the same window.
    earlier : SearchResult, optional
        Result of an earlier search of the same problem, to be combined with this one.
    log : callable, optional
        Receives one line a generation.
    aim : Aim, optional
        What the search is made for: it ends once it is unlikely to get so low.

    Returns
    -------
    PolynomialEstimate

    Raises
    ------
    ValueError
        When a signal is not real, finite or of moderate size, the record is too short for the
        orders, or a setting is outside its range.

    Examples
    --------
    >>> import evopem
    >>> from evopem.synthesis.armax import armax
    >>> recording, truth = armax(seed=1, samples=1000)
    >>> found = evopem.estimate(
    ...     recording.input,
    ...     recording.output,
    ...     orders=truth.orders,
    ...     sampling_rate=recording.sampling_rate,
    ...     settings=evopem.SearchSettings(objective="quadratic", seed=1),
    ... )
    >>> [round(mode.frequency_hz) for mode in found.model.modes()]
    [5, 17, 37]
    >>> found.search.diagnostics.n_confirming >= 1
    True
    """
    orders = orders if isinstance(orders, Orders) else armax_orders(*_whole_numbers(orders))
    settings = settings or SearchSettings()
    u, y = real_signal(input, "input"), real_signal(output, "output")
    if not (np.isfinite(sampling_rate) and sampling_rate > 0.0):
        raise ValueError(f"sampling_rate must be a positive number of Hz, not {sampling_rate}")
    window = window or default_window(orders, settings)
    _check(u, y, orders, settings, window)
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        errors = prediction_errors(u, y, orders, settings, window)
        problem, scales = _scaled_problem(errors, settings.initialization)
        key = (orders.na, orders.single.nb, orders.nc, orders.single.nk)
        result = continued_search(problem, scales, key, settings, earlier, log, aim=aim)
        del problem  # its tables are as large as those that follow
        return describe(errors, result, sampling_rate)


def default_window(orders: Orders, settings: SearchSettings) -> ScoringWindow:
    """The window of an estimate that is not compared with models of other orders.

    Examples
    --------
    >>> default_window(armax_orders(7, 6, 7, 3), SearchSettings(n_initial_discard=50))
    ScoringWindow(residual_start=8, loss_start=58)
    """
    first = max(orders.first_residual, orders.nc)
    return ScoringWindow(first, first + max(settings.n_initial_discard, orders.nc))


def prediction_errors(
    input: Array,  # noqa: A002
    output: Array,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow,
) -> PredictionErrorProblem:
    """The prediction-error problem of a record, orders and settings.

    The compiled recursion needs :data:`MIN_NC` samples before the first residual.
    """
    return PredictionErrorProblem(
        input,
        output,
        orders,
        settings.objective,
        max(window.residual_start, MIN_NC),
        max(window.loss_start, MIN_NC),
        settings.max_root_radius,
    )


def descend_from(
    point: ArrayLike, errors: PredictionErrorProblem, sampling_rate: float, earlier: SearchResult
) -> PolynomialEstimate:
    """Descend once from a point, and combine the result with an earlier search of the problem.

    Parameters
    ----------
    point : (n,) array_like
        Parameters and noise state, in the problem's own units.
    errors : PredictionErrorProblem
    sampling_rate : float
        Hz.
    earlier : SearchResult
    """
    problem, scales = _scaled_problem(errors, "arx")
    ended = descended(problem, np.asarray(point) / scales)
    ended = replace(ended, point=ended.point * scales)
    return describe(errors, pooled(earlier, ended), sampling_rate)


def describe(
    errors: PredictionErrorProblem, result: SearchResult, sampling_rate: float
) -> PolynomialEstimate:
    """The model at a search's best point, with its criteria, residuals and covariance."""
    orders, start = errors.orders, errors.scoring_start
    point, residuals, triangle = _identifiable(errors, result.point)
    a, b, c = _coefficients(point, orders)
    scored, scored_output = residuals[start:], errors.output[start:]
    model = PolynomialModel(
        a,
        b,
        c,
        nk=orders.single.nk,
        sampling_rate=sampling_rate,
        structure="armax",
        noise_variance=innovation_variance(scored, triangle.shape[1]),
        covariance=estimate_covariance(
            triangle, scored, scored_output, orders.parameters, orders.nc, errors.objective
        ),
    )
    residuals[: errors.recursion_start] = np.nan
    radius = max(largest_radius(a[1:]), largest_radius(c[1:]))
    return PolynomialEstimate(
        model=model,
        criteria=criteria_of(scored, scored_output, errors.objective, orders.parameters),
        residuals=residuals,
        plant_state=np.empty(0),
        noise_state=point[orders.parameters :].copy(),
        window=ScoringWindow(errors.recursion_start, start),
        at_stability_bound=lies_at_bound(radius, errors.max_root_radius),
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
    bare = PolynomialModel(*_coefficients(point, errors.orders), nk=errors.orders.single.nk)
    triangle = jacobian_triangle(
        bare, errors.input, errors.output, residuals, errors.recursion_start, errors.scoring_start
    )
    return residuals, triangle


def _coefficients(point: Array, orders: Orders) -> tuple[Array, Array, Array]:
    """A, B and C of a point."""
    a, b, c = np.split(point[: orders.parameters], [orders.na, orders.na + orders.single.nb])
    return np.concatenate([[1.0], a]), b.copy(), np.concatenate([[1.0], c])


def _scaled_problem(
    errors: PredictionErrorProblem, initialization: str
) -> tuple[ArmaxProblem, Array]:
    """The problem with signals scaled to moderate size, and the scales of its parameters.

    Powers of two leave every bit of signals and points unchanged.
    """
    u, y, orders = errors.input, errors.output, errors.orders
    input_scale, output_scale = power_of_two_scale(u), power_of_two_scale(y)
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
    scales[orders.na : orders.na + orders.single.nb] = output_scale / input_scale
    scales[orders.parameters :] = output_scale
    return ArmaxProblem(scaled, initialization), scales


def _whole_numbers(orders: Iterable[int]) -> list[int]:
    """Orders as whole numbers, NumPy's among them."""
    orders = tuple(orders)
    try:
        na, nb, nc, nk = (operator.index(order) for order in orders)
    except (TypeError, ValueError):
        raise ValueError(
            f"orders must be four whole numbers na, nb, nc and nk, not {orders}"
        ) from None
    return [na, nb, nc, nk]


def _check(
    u: Array, y: Array, orders: Orders, settings: SearchSettings, window: ScoringWindow
) -> None:
    check_signals(u, y)
    for name, signal in (("input", u), ("output", y)):
        largest = float(np.max(np.abs(signal)))
        if largest and not 1.0 / LARGEST < largest < LARGEST:
            raise ValueError(
                f"the largest magnitude of the {name} is {largest:g}; scale it between "
                f"{1.0 / LARGEST:g} and {LARGEST:g}"
            )
    check_search_settings(settings)
    check_window(window, max(orders.first_residual, orders.nc), orders)
    scored = len(y) - window.loss_start
    if scored <= orders.parameters:
        raise ValueError(
            f"{orders} has {orders.parameters} parameters and needs more residuals than "
            f"that; {len(y)} samples less the first {window.loss_start} leave {scored}"
        )
    if not np.any(y[window.loss_start :]):
        raise ValueError("the output is zero throughout")
