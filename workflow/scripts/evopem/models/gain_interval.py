"""Confidence interval of a model's gain over frequency."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.polynomial import PolynomialModel

Array = NDArray[np.float64]

NORMAL_95 = 1.959963984540054
"""97.5 % point of the standard normal distribution."""


def gain_band(model: PolynomialModel, frequencies: ArrayLike) -> tuple[Array, Array]:
    """Lower and upper end of the 95 % confidence interval of ``|G|`` at frequencies in Hz.

    The parameter covariance is propagated to ``ln |G|`` to first order (Ljung 1999, section 9.4),
    so the interval has the same width in decibels above and below, and is never negative.

    Both ends are NaN where the gain is zero, where the covariance is not known, and where the gain
    depends on a direction of the parameters that the data do not determine, as between the lines
    of a periodic input. The upper end is infinite where it leaves the range of numbers.

    Parameters
    ----------
    model : PolynomialModel
    frequencies : (M,) array_like
        Hz.

    Returns
    -------
    lower, upper : (M,) arrays

    Examples
    --------
    >>> from evopem.models.polynomial import PolynomialModel
    >>> from evopem.models.parameter_covariance import ParameterCovariance
    >>> covariance = ParameterCovariance.from_matrix(1e-4 * np.eye(2))
    >>> model = PolynomialModel(
    ...     np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1, covariance=covariance
    ... )
    >>> lower, upper = gain_band(model, [0.0])  # around the gain 4
    >>> lower.round(3), upper.round(3)
    (array([3.842]), array([4.165]))
    """
    frequencies = np.asarray(frequencies, dtype=float)
    if model.covariance is None:
        return np.full(frequencies.shape, np.nan), np.full(frequencies.shape, np.nan)
    orders = model.orders
    delay = np.exp(-2j * np.pi * frequencies / model.sampling_rate)[:, None]
    denominator = np.polynomial.polynomial.polyval(delay, model.a)
    numerator = np.polynomial.polynomial.polyval(delay, model.delayed_b)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # d ln G / da_i = -q^-i / A and d ln G / db_j = q^-(nk+j) / B.
        by_a = -(delay ** np.arange(1, orders.na + 1)) / denominator
        by_b = delay ** np.arange(orders.nk, orders.nk + orders.nb) / numerator
        errors = model.covariance.part(slice(orders.na + orders.nb)).standard_errors(
            np.hstack([by_a, by_b]).real
        )
        errors[~np.isfinite(errors)] = np.nan
        spread = np.exp(NORMAL_95 * errors)
        gain = np.abs(numerator / denominator)[:, 0]
        return gain / spread, gain * spread
