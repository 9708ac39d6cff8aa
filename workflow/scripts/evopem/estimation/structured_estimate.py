"""Estimate a model of any structure: the function behind ``evopem.estimate``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.constraints import Constraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation import estimate as armax
from evopem.estimation import polynomial_estimate
from evopem.estimation.focused_estimate import estimate_focused
from evopem.estimation.joined_estimate import describe_joined, joined_errors
from evopem.estimation.polynomial_estimate import (
    PolynomialEstimate,
    estimate_polynomial,
    polynomial_errors,
)
from evopem.estimation.search.likely_gain import Aim
from evopem.estimation.search.problem import SearchResult
from evopem.models.structures import PolynomialOrders, orders_of
from evopem.signals.recording import Recording

Array = NDArray[np.float64]


def estimate(
    input: ArrayLike | None,  # noqa: A002 - the field's word
    output: ArrayLike,
    orders: PolynomialOrders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    structure: str = "armax",
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    focus: str | int = "prediction",
    constraints: Constraints | None = None,
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
    aim: Aim | None = None,
) -> PolynomialEstimate:
    """Find the model of a structure and orders with the smallest prediction errors, globally.

    Parameters
    ----------
    input, output : (N,) array_like
        The record; not modified.  ``input`` is None for ``structure="arma"``.
    orders : PolynomialOrders, mapping or sequence
        ``{"na": 2, "nb": 2, "nc": 2, "nk": 1}``, or MATLAB's tuple for the structure.
    sampling_rate : float
        Hz.
    structure : str
        A key of :data:`evopem.config.structures.STRUCTURES`: ``fir``, ``arx``, ``arma``,
        ``armax``, ``ararx``, ``ararmax``, ``oe``, ``bj`` or ``general``.
    settings : SearchSettings, optional
    window : ScoringWindow, optional
    level : bool
        Whether a constant is estimated along.
    focus : {"prediction", "simulation"} or int
        The errors to be small: of one step, of simulation, or of predictions that many samples
        ahead.
    constraints : Constraints, optional
        What the model must meet, and priors.
    earlier : SearchResult, optional
        Result of an earlier search of the same problem, to be combined with this one.
    log : callable, optional
        Receives one line a generation.
    aim : Aim, optional
        What the search is made for: it ends once it is unlikely to get so low.

    Returns
    -------
    PolynomialEstimate
        For ``armax`` without a level, of :func:`evopem.estimation.estimate.estimate`, which is
        faster; else of :func:`evopem.estimation.polynomial_estimate.estimate_polynomial`; with a
        focus or constraints, of :func:`evopem.estimation.focused_estimate.estimate_focused`.

    Raises
    ------
    InputError
        When constraints contradict each other, the structure or the focus.
    ValueError
        When the record is too short for the orders, or a setting is outside its range.

    Examples
    --------
    >>> import evopem
    >>> from evopem.synthesis.armax import armax
    >>> recording, truth = armax(seed=1, samples=1000)
    >>> found = evopem.estimate(
    ...     recording.input,
    ...     recording.output,
    ...     orders=(7, 6, 7, 3),
    ...     sampling_rate=100.0,
    ...     settings=evopem.SearchSettings(objective="quadratic", seed=1),
    ... )
    >>> [round(mode.frequency_hz) for mode in found.model.modes()]
    [5, 17, 37]
    """
    if structure == "armax" and input is None:
        raise ValueError("structure 'armax' needs an input; without one, use 'arma'")
    if focus != "prediction" or constraints is not None:
        if earlier is not None:
            raise ValueError("an earlier search is not continued with a focus or constraints")
        return estimate_focused(
            input,
            output,
            structure,
            orders,
            sampling_rate,
            settings=settings,
            window=window,
            level=level,
            focus=focus,
            constraints=constraints,
            log=log,
        )
    orders = orders_of(structure, orders)
    if input is not None and has_own_search(orders, level):
        return armax.estimate(
            input,
            output,
            orders,
            sampling_rate,
            settings=settings,
            window=window,
            earlier=earlier,
            log=log,
            aim=aim,
        )
    return estimate_polynomial(
        input,
        output,
        structure,
        orders,
        sampling_rate,
        settings=settings,
        window=window,
        level=level,
        earlier=earlier,
        log=log,
        aim=aim,
    )


def has_own_search(orders: PolynomialOrders, level: bool) -> bool:
    """Whether models are estimated by the search for ARMAX models, with kernels of its own."""
    return orders.structure == "armax" and orders.nb > 0 and not level


def described(
    result: SearchResult,
    data: Recording,
    orders: PolynomialOrders,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool,
) -> PolynomialEstimate:
    """The full estimate at the end of a search, with residuals and covariance."""
    if data.is_joined:
        with one_blas_thread():
            joined = joined_errors(data.stretches, orders, settings, window, level)
            return describe_joined(joined, result, data.sampling_rate)
    with one_blas_thread():
        if has_own_search(orders, level):
            errors = armax.prediction_errors(data.input, data.output, orders, settings, window)
            return armax.describe(errors, result, data.sampling_rate)
        general = polynomial_errors(data.input, data.output, orders, settings, window, level)
        return polynomial_estimate.describe(general, result, data.sampling_rate)


def descended_from(
    point: Array,
    earlier: SearchResult,
    data: Recording,
    orders: PolynomialOrders,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool,
) -> PolynomialEstimate:
    """The estimate after one descent from a point, pooled with an earlier search."""
    with one_blas_thread():
        if has_own_search(orders, level):
            errors = armax.prediction_errors(data.input, data.output, orders, settings, window)
            return armax.descend_from(point, errors, data.sampling_rate, earlier)
        general = polynomial_errors(data.input, data.output, orders, settings, window, level)
        return polynomial_estimate.descend_from(point, general, data.sampling_rate, earlier)
