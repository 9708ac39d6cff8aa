"""Confidence intervals of a model's gain and phase over frequency."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.polynomial import PolynomialModel

Array = NDArray[np.float64]

NORMAL_95 = 1.959963984540054
"""97.5 % point of the standard normal distribution."""


Filter = Literal["plant", "noise"]


def gain_band(
    model: PolynomialModel, frequencies: ArrayLike, which: Filter = "plant"
) -> tuple[Array, Array]:
    """Lower and upper end of the 95 % confidence interval of a gain at frequencies in Hz.

    As :func:`response_interval` has them.

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
    return response_interval(model, frequencies, which)[:2]


def response_interval(
    model: PolynomialModel, frequencies: ArrayLike, which: Filter = "plant"
) -> tuple[Array, Array, Array]:
    """95 % confidence interval of a gain, and standard error of a phase, at frequencies in Hz.

    The parameter covariance is propagated to ``ln G``, whose real part is ``ln |G|`` and whose
    imaginary part is the phase, to first order (Ljung 1999, section 9.4), so the interval has the
    same width in decibels above and below, and is never negative.

    All are NaN where the gain is zero, where the covariance is not known, and where the response
    depends on a direction of the parameters that the data do not determine, as between the lines
    of a periodic input. The upper end is infinite where it leaves the range of numbers.

    Parameters
    ----------
    model : PolynomialModel
    frequencies : (M,) array_like
        Hz.
    which : {"plant", "noise"}
        ``G = B / (A F)`` or ``H = C / (A D)``.

    Returns
    -------
    lower, upper, phase_error : (M,) arrays
        The standard error of the phase in radians.
    """
    frequencies = np.asarray(frequencies, dtype=float)
    if model.covariance is None:
        unknown = np.full(frequencies.shape, np.nan)
        return unknown, unknown, unknown
    delay = np.exp(-2j * np.pi * frequencies / model.sampling_rate)[:, None]
    above, below = ("b", "af") if which == "plant" else ("c", "ad")
    slopes = np.zeros((len(frequencies), model.orders.parameters), dtype=complex)
    response = model.frequency_response if which == "plant" else model.noise_response
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # d ln G / da_i = -q^-i / A and d ln G / db_j = q^-(nk+j) / B.
        for letter in (above, *below):
            coefficients = model.delayed_b if letter == "b" else getattr(model, letter)
            part = model.part(letter)
            first = model.delay if letter == "b" else 1
            lags = np.arange(first, first + part.stop - part.start)
            sign = 1.0 if letter == above else -1.0
            value = np.polynomial.polynomial.polyval(delay, coefficients)
            slopes[:, part] = sign * delay**lags / value
        errors, phase_errors = (
            model.covariance.standard_errors(part) for part in (slopes.real, slopes.imag)
        )
        errors[~np.isfinite(errors)] = np.nan
        phase_errors[~np.isfinite(phase_errors)] = np.nan
        spread = np.exp(NORMAL_95 * errors)
        gain = np.abs(response(frequencies)[..., 0, 0])
        return gain / spread, gain * spread, phase_errors
