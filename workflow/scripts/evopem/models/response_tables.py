"""A model's modes and responses as tables."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from evopem.models.gain_interval import NORMAL_95, Filter, response_interval
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_intervals import response_standard_errors
from evopem.models.polynomials import max_root_radius

Array = NDArray[np.float64]

FREQUENCIES = 2049
# Samples of a time response: until it has settled to this share, within limits.
SETTLED = 1e-3
FEWEST_SAMPLES, MOST_SAMPLES = 50, 1000


def modes_table(model: PolynomialModel) -> dict[str, list[float] | list[str]]:
    """Modes by polynomial and frequency: Hz and percent with standard errors, and their poles.

    Poles of F are those of the plant, poles of D those of the noise filter, and poles of A belong
    to both.
    """
    modes = [
        (letter.upper(), mode) for letter in "afd" for mode in model.modes_of_polynomial(letter)
    ]
    return {
        "polynomial": [letter for letter, _ in modes],
        "frequency_hz": [mode.frequency_hz for _, mode in modes],
        "frequency_se_hz": [mode.frequency_se_hz for _, mode in modes],
        "damping_percent": [100.0 * mode.damping_ratio for _, mode in modes],
        "damping_se_percent": [100.0 * mode.damping_se for _, mode in modes],
        "pole_real": [mode.pole.real for _, mode in modes],
        "pole_imag": [mode.pole.imag for _, mode in modes],
        "radius": [abs(mode.pole) for _, mode in modes],
    }


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
