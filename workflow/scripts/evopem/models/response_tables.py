"""A model's modes and responses as tables."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import max_root_radius

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

    ``frequencies`` (M,): Hz.  ``which`` {"plant", "noise"}: ``G = B / (A F)`` or ``H = C / (A D)``.
    Returns (M,): The standard error of the phase in radians.
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


# Step of a central difference, in standard errors of a coefficient: small against the curvature of
# a response, large against rounding.
STEP = 1e-3


def response_standard_errors(
    model: PolynomialModel, response: Callable[[PolynomialModel], Array]
) -> Array:
    """Standard errors of a real function of a model, to first order (Ljung 1999, section 9.4).

    ``model``: with a covariance.  ``response``: for instance ``lambda model:
    model.step_response(100)``, or ``lambda model: 20 *
    np.log10(np.abs(model.frequency_response(frequencies)))``.  Returns of the shape of the
    response; infinite where it depends on a direction of the coefficients that the data do not
    determine.  Raises ValueError when the model has no covariance.
    """
    if model.covariance is None:
        raise ValueError("the model has no covariance of its coefficients")
    point = model.parameters
    slopes = []
    deviations = model.covariance.standard_errors(np.eye(len(point)))
    for index, deviation in enumerate(deviations):
        step = np.zeros(len(point))
        # Of a coefficient without a finite standard error, a step of its own size.
        size = deviation if 0.0 < deviation < np.inf else max(abs(point[index]), 1.0)
        step[index] = STEP * size
        up, down = (response(model.with_parameters(point + sign * step)) for sign in (1, -1))
        slopes.append((up - down) / (2.0 * step[index]))
    jacobian = np.array(slopes)
    errors = model.covariance.standard_errors(jacobian.reshape(len(point), -1).T)
    return errors.reshape(jacobian.shape[1:])


Array = NDArray[np.float64]

FREQUENCIES = 2049
# Samples of a time response: until it has settled to this share, within limits.
SETTLED = 1e-3
FEWEST_SAMPLES, MOST_SAMPLES = 50, 1000


def frequency_response_table(model: PolynomialModel) -> dict[str, Array]:
    """Gain of plant and noise filter with 95 % bands, and unwrapped phases, to half the rate.

    NaN for the plant of a model without input.
    """
    frequencies = np.linspace(0.0, model.sampling_rate / 2.0, FREQUENCIES)
    return {
        "frequency_hz": frequencies,
        **_response_columns(model, "plant", frequencies),
        **{
            f"noise_{name}": column
            for name, column in _response_columns(model, "noise", frequencies).items()
        },
    }


def _unwrapped(angles: Array) -> Array:
    """Continuous angles, NaN where there is none, as at the frequency of an integrator."""
    known, unwrapped = np.isfinite(angles), np.full(len(angles), np.nan)
    unwrapped[known] = np.unwrap(angles[known])
    return unwrapped


def _response_columns(
    model: PolynomialModel, which: Filter, frequencies: Array
) -> dict[str, Array]:
    if which == "plant" and not model.has_input:
        names = ("gain", "gain_lower", "gain_upper", "phase_deg", "phase_se_deg")
        return {name: np.full(len(frequencies), np.nan) for name in names}
    of = model.frequency_response if which == "plant" else model.noise_response
    response = of(frequencies)[..., 0, 0]
    lower, upper, phase_error = response_interval(model, frequencies, which)
    return {
        "gain": np.abs(response),
        "gain_lower": lower,
        "gain_upper": upper,
        "phase_deg": np.degrees(_unwrapped(np.angle(response))),
        "phase_se_deg": np.degrees(phase_error),
    }


def time_response_table(model: PolynomialModel) -> dict[str, Array]:
    """Impulse and step response of the plant and impulse response of the noise filter.

    Each with its 95 % interval, to first order in the coefficients; NaN where there is none.
    """
    samples = response_length(model)
    table = {"time_s": np.arange(samples) / model.sampling_rate}
    responses = {
        "impulse": (model.has_input, lambda m: m.impulse_response(samples)),
        "step": (model.has_input, lambda m: m.step_response(samples)),
        "noise_impulse": (True, lambda m: m.noise_impulse_response(samples)),
    }
    for name, (exists, response) in responses.items():
        values = response(model) if exists else np.full(samples, np.nan)
        errors = np.full(samples, np.nan)
        if exists and model.covariance is not None:
            errors = response_standard_errors(model, response)
            errors[~np.isfinite(errors)] = np.nan
        table |= {
            name: values,
            f"{name}_lower": values - NORMAL_95 * errors,
            f"{name}_upper": values + NORMAL_95 * errors,
        }
    return table


def response_length(model: PolynomialModel) -> int:
    """Number of samples in which the responses of a model settle, within limits."""
    radius = max(max_root_radius(getattr(model, letter)[1:]) for letter in "adf")
    settling = MOST_SAMPLES
    if radius < 1.0:
        settling = math.ceil(math.log(SETTLED) / math.log(radius)) if radius > 0.0 else 0
    memory = len(model.delayed_b) + len(model.c)
    return min(max(settling + memory, FEWEST_SAMPLES), MOST_SAMPLES)
