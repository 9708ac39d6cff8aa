"""Simulation and prediction of held-out stretches, from the initial state that fits them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_states import estimate_prediction_states
from evopem.signals.stretches import Stretch

Array = NDArray[np.float64]


# Iterations of reweighted least squares towards least absolute deviations.
REWEIGHTINGS = 5


def simulated(
    model: PolynomialModel, stretch: Stretch, free_level: bool = False, robust: bool = False
) -> Array:
    """Simulation from the initial state that fits the stretch, (N,).

    The level is filtered through 1/A from rest instead of being added as ``level / A(1)``: the
    initial state takes up the difference, and a pole at 1 makes no division by zero.

    Parameters
    ----------
    model : PolynomialModel
    stretch : Stretch
    free_level : bool
        Whether the level belongs to the state and is fitted to the stretch as well.
    robust : bool
        Whether the state has the least absolute instead of the least squared errors.
    """
    from scipy.signal import lfilter

    n = stretch.samples
    response = lfilter(model.delayed_b, model.plant_denominator, stretch.input)
    response = response + lfilter([model.level], model.a, np.ones(n))
    impulse = np.zeros(n)
    impulse[0] = 1.0
    decay = lfilter([1.0], model.plant_denominator, impulse)
    count = min(model.state_dimension, n - 1)
    columns = np.zeros((n, count + int(free_level)))
    for k in range(count):
        columns[k:, k] = decay[: n - k]
    columns[:, count:] = 1.0
    if not (np.isfinite(columns).all() and np.isfinite(response).all()):
        return np.full(n, np.inf)
    if columns.shape[1]:
        remainder = stretch.output - response
        state = np.linalg.lstsq(columns, remainder, rcond=1e-10)[0]
        for _ in range(REWEIGHTINGS if robust else 0):
            size = np.abs(remainder - columns @ state)
            weights = 1.0 / np.sqrt(np.maximum(size, 0.1 * np.mean(size) + 1e-300))
            weighted = columns * weights[:, None]
            state = np.linalg.lstsq(weighted, remainder * weights, rcond=1e-10)[0]
        response = response + columns @ state
    return np.asarray(response)


def prediction_errors(model: PolynomialModel, stretch: Stretch) -> Array:
    """One-step prediction errors with fitted initial states, from the first residual on."""
    if stretch.samples <= model.orders.first_residual + 1:
        return np.empty(0)
    states = estimate_prediction_states(model, stretch.input, stretch.output)
    errors = model.residuals(stretch.input, stretch.output, *states)
    return errors[model.orders.first_residual :]
