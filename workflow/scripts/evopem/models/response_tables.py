"""A model's modes and frequency response as tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel
from evopem.models.gain_interval import gain_band

Array = NDArray[np.float64]

FREQUENCIES = 2049


def modes_table(model: PolynomialModel) -> dict[str, list[float]]:
    """Modes by frequency: Hz and percent with standard errors, and the pole of each."""
    modes = model.modes()
    return {
        "frequency_hz": [mode.frequency_hz for mode in modes],
        "frequency_se_hz": [mode.frequency_se_hz for mode in modes],
        "damping_percent": [100.0 * mode.damping_ratio for mode in modes],
        "damping_se_percent": [100.0 * mode.damping_se for mode in modes],
        "pole_real": [mode.pole.real for mode in modes],
        "pole_imag": [mode.pole.imag for mode in modes],
        "radius": [abs(mode.pole) for mode in modes],
    }


def frequency_response_table(model: PolynomialModel) -> dict[str, Array]:
    """Gain of G with its 95 % band, and unwrapped phase in degrees, from 0 to half the rate."""
    frequencies = np.linspace(0.0, model.sampling_rate / 2.0, FREQUENCIES)
    response = model.frequency_response(frequencies)
    lower, upper = gain_band(model, frequencies)
    return {
        "frequency_hz": frequencies,
        "gain": np.abs(response),
        "gain_lower": lower,
        "gain_upper": upper,
        "phase_deg": np.degrees(np.unwrap(np.angle(response))),
    }
