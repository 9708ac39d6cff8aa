"""How well a model knows its own frequency response."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.armax import ArmaxModel

Array = NDArray[np.float64]

NORMAL_95 = 1.959963984540054
"""97.5 % point of the standard normal distribution."""


def gain_band(model: ArmaxModel, frequencies: ArrayLike) -> tuple[Array, Array]:
    """Lower and upper end of the 95 % band of the gain ``|G|`` at frequencies in Hz.

    The parameter covariance is carried to ``ln |G|`` to first order (Ljung 1999, section 9.4),
    so the band is of constant width in decibels and never below zero. NaN where the gain is
    zero or the covariance is not known; the upper end is infinite where it leaves the range of
    numbers.

    Parameters
    ----------
    model : ArmaxModel
    frequencies : (M,) array_like
        Hz.

    Returns
    -------
    lower, upper : (M,) arrays
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
        jacobian = np.hstack([by_a, by_b]).real
        count = orders.na + orders.nb
        covariance = model.covariance[:count, :count]
        variance = np.einsum("fi,ij,fj->f", jacobian, covariance, jacobian)
        spread = np.exp(NORMAL_95 * np.sqrt(np.maximum(variance, 0.0)))
        gain = np.abs(numerator / denominator)[:, 0]
        return gain / spread, gain * spread
