"""The search for the polynomial model of given orders, and estimates at the end of one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation.criteria import power_of_two_scale
from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.estimation.pem.stretch_errors import StretchErrors
from evopem.estimation.polynomial_estimate import Errors, PolynomialEstimate, describe
from evopem.estimation.requirements import check_search_settings, check_signals, check_window
from evopem.estimation.search.armax_problem import ArmaxProblem
from evopem.estimation.search.global_search import continued_search
from evopem.estimation.search.likely_gain import Aim
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchResult, descended, pooled
from evopem.estimation.search.stretch_problem import StretchProblem
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import LARGEST

Array = NDArray[np.float64]
SomeErrors = TypeVar("SomeErrors", bound=Errors)


def estimate_polynomial(
    data: Recording,
    orders: Orders,
    *,
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
    aim: Aim | None = None,
) -> PolynomialEstimate:
    """Find the polynomial model of given orders with the smallest prediction errors, globally.

    Parameters
    ----------
    data : Recording
        At most one input, and one output.  One objective over all segments; each has an initial
        state of the plant and of the noise filter, and each recording a level where one is
        estimated.
    orders : Orders
    settings : SearchSettings, optional
        Objective, seed, bounds and size of the search.  Its draws come from
        ``SeedSequence(seed, spawn_key=(na, nb, nc, nd, nf, nk, level))``, without nd, nf and level
        for ARMAX models of one segment, with the number of its restarts appended to the key when
        the search continues an earlier one.  Only the latter use ``initialization`` and
        ``n_initial_discard``: the first population of the others holds estimates of several kinds.
    window : ScoringWindow, optional
        By default that of :func:`default_window`, of each segment.
    level : bool
        Whether a constant is estimated: ``A y = (B/F) u + (C/D) e + level``.
    earlier : SearchResult, optional
        Result of an earlier search of the same problem, to be combined with this one.
    log : callable, optional
        Receives one line a generation.
    aim : Aim, optional
        What the search is made for: it ends once it is unlikely to get so low.

    Raises
    ------
    ValueError
        When the record is too short for the orders, or a setting is outside its range.
    """
    o, settings = orders, settings or SearchSettings()
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        errors = checked_errors(data, orders, settings, window, level)
        scaled, scales = scaled_errors(errors)
        problem = problem_of(scaled, settings.initialization)
        key: tuple[int, ...] = (o.na, o.single.nb, o.nc, o.single.nk)
        recombine = None
        if isinstance(problem, PolynomialProblem):
            recombine = problem.recombine
            key = (o.na, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk, int(level))
        found = continued_search(problem, scales, key, settings, earlier, log, recombine, aim)
        del problem, scaled  # their tables are as large as those that follow
        return describe(errors, found, data.sampling_rate, shortest=True)


def default_window(orders: Orders, settings: SearchSettings) -> ScoringWindow:
    """The window of an estimate that is not compared with models of other orders.

    The first residual is the first that has all its measured past.  All residuals count, but those
    of ARMAX models, which have at least nc before them, without the first
    ``settings.n_initial_discard``.

    Examples
    --------
    >>> default_window(Orders(na=7, nb=6, nc=7, nk=3), SearchSettings(n_initial_discard=50))
    ScoringWindow(residual_start=8, loss_start=58)
    """
    if orders.structure != "armax":
        return ScoringWindow(orders.first_residual, orders.first_residual)
    first = max(orders.first_residual, orders.nc)
    return ScoringWindow(first, first + max(settings.n_initial_discard, orders.nc))


def prediction_errors(
    data: Recording, orders: Orders, settings: SearchSettings, window: ScoringWindow, level: bool
) -> Errors:
    """The prediction-error problem of a recording, orders and settings.

    Raises
    ------
    ValueError
        When none of several segments is long enough for the orders.
    """
    radius = settings.max_root_radius
    if data.is_joined:
        return StretchErrors(
            *(data.segments, orders, settings.objective, radius, radius, level), window=window
        )
    return PolynomialErrors(
        data.input,
        data.output,
        orders,
        settings.objective,
        window.residual_start,
        window.loss_start,
        radius,
        radius,
        level,
    )


def checked_errors(
    data: Recording,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow | None,
    level: bool,
) -> Errors:
    """The prediction-error problem of a recording as a user gives it.

    Raises
    ------
    ValueError
        When the record is too short for the orders, or a setting is outside its range.
    """
    check_search_settings(settings)
    alone = orders.structure == "armax" and not level and not data.is_joined
    if window is None:
        whole = ScoringWindow(orders.first_residual, orders.first_residual)
        window = default_window(orders, settings) if alone else whole
    if not data.has_input and orders.single.nb:
        raise ValueError(
            f"structure {orders.structure!r} with nb = {orders.single.nb} needs an input"
        )
    if not data.is_joined:
        first = max(orders.first_residual, orders.nc if alone else 0)
        check_window(window, first, orders)
        states = 0 if alone else orders.single.nf + orders.noise_states
        _check_record(data, orders, window, orders.parameters + states)
    return prediction_errors(data, orders, settings, window, level)


def _check_record(data: Recording, orders: Orders, window: ScoringWindow, estimated: int) -> None:
    """Refuse a record that no model of the orders can be estimated from."""
    check_signals(data.input, data.output)
    for name, signal in (("input", data.input), ("output", data.output)):
        largest = float(np.max(np.abs(signal)))
        if largest and not 1.0 / LARGEST < largest < LARGEST:
            raise ValueError(
                f"the largest magnitude of the {name} is {largest:g}; scale it between "
                f"{1.0 / LARGEST:g} and {LARGEST:g}"
            )
    counted = data.samples - window.loss_start
    if counted <= estimated:
        raise ValueError(
            f"{orders} needs more than {estimated} residuals for its coefficients and initial "
            f"states; {data.samples} samples less the first {window.loss_start} leave {counted}"
        )
    if not np.any(data.output[window.loss_start :]):
        raise ValueError("the output is zero throughout")


def scaled_errors(errors: SomeErrors) -> tuple[SomeErrors, Array]:
    """The problem with signals scaled to moderate size, and the scales of its parameters.

    Powers of two leave every bit of signals and points unchanged.
    """
    input_scale, output_scale = (power_of_two_scale(each) for each in errors.signals)
    scales, parts = np.ones(errors.dimension), errors.parts()
    scales[parts["b"]] = output_scale / input_scale
    for name in ("level", "plant", "noise"):
        scales[parts[name]] = output_scale
    return cast(SomeErrors, errors.scaled(input_scale, output_scale)), scales


def problem_of(errors: Errors, initialization: str = "arx") -> ArmaxProblem | PolynomialProblem:
    """The search problem of prediction errors: that of the chapter for ARMAX models.

    Parameters
    ----------
    errors : PolynomialErrors or StretchErrors
    initialization : {"arx", "incremental_order"}
        Of ARMAX models of one segment without a level.
    """
    if isinstance(errors, StretchErrors):
        return StretchProblem(errors)
    of_armax = errors.orders.structure == "armax" and errors.orders.single.nb > 0
    if of_armax and not errors.level:
        return ArmaxProblem(errors, initialization)
    return PolynomialProblem(errors)


def described(
    result: SearchResult,
    data: Recording,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool,
) -> PolynomialEstimate:
    """The full estimate at the end of a search, with residuals and covariance."""
    with one_blas_thread():
        errors = prediction_errors(data, orders, settings, window, level)
        return describe(errors, result, data.sampling_rate, shortest=True)


def descended_from(
    start: ArrayLike | PolynomialModel,
    earlier: SearchResult,
    data: Recording,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool,
) -> PolynomialEstimate:
    """The estimate after one descent, pooled with an earlier search of the problem.

    Parameters
    ----------
    start : (n,) array_like or PolynomialModel
        A point in the problem's own units, or of several segments a model of smaller orders.
    earlier : SearchResult
    data, orders, settings, window, level
        As for :func:`prediction_errors`.
    """
    with one_blas_thread():
        errors = prediction_errors(data, orders, settings, window, level)
        scaled, scales = scaled_errors(errors)
        problem = problem_of(scaled)
        if not isinstance(start, PolynomialModel):
            point: Array | None = np.asarray(start) / scales
        elif isinstance(scaled, StretchErrors):
            point = _adapted(start, scaled, scales)
        else:
            raise TypeError("of one segment, start from a point")
        if point is None:
            return describe(errors, earlier, data.sampling_rate, shortest=True)
        ended = descended(problem, point)
        ended = replace(ended, point=ended.point * scales)
        return describe(errors, pooled(earlier, ended), data.sampling_rate, shortest=True)


def _adapted(model: PolynomialModel, scaled: StretchErrors, scales: Array) -> Array | None:
    """The best point of a scaled problem next to a model in the units of the signals."""
    of_b = scales[scaled.parts()["b"]]
    own = tuple(b / of_b[0] for b in model.B) if len(of_b) else model.B
    in_its_units = replace(model, B=own, covariance=None)
    starts = StretchProblem(scaled, [in_its_units], own_starts=False).starts()
    return starts[0] if len(starts) else None
