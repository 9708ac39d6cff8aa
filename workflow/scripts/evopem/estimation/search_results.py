"""What a search has found, as an estimate; and descents that go on from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.blas_threads import one_blas_thread
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation import estimate as armax
from evopem.estimation import polynomial_estimate
from evopem.estimation.joined_estimate import describe_joined, joined_errors
from evopem.estimation.polynomial_estimate import PolynomialEstimate, polynomial_errors
from evopem.estimation.search.problem import SearchResult
from evopem.models.structures import Orders
from evopem.signals.recording import Recording

Array = NDArray[np.float64]


def has_own_search(orders: Orders, level: bool) -> bool:
    """Whether models are estimated by the search for ARMAX models, with kernels of its own."""
    return orders.structure == "armax" and orders.single.nb > 0 and not level


def described(
    result: SearchResult,
    data: Recording,
    orders: Orders,
    settings: SearchSettings,
    window: ScoringWindow,
    level: bool,
) -> PolynomialEstimate:
    """The full estimate at the end of a search, with residuals and covariance."""
    if data.is_joined:
        with one_blas_thread():
            joined = joined_errors(data.segments, orders, settings, window, level)
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
    orders: Orders,
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
