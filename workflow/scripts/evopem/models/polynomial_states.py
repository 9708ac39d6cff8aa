"""Initial states of polynomial models, from a stretch of measured signals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel

Array = NDArray[np.float64]


def estimate_simulation_state(
    model: PolynomialModel,
    input: Array,  # noqa: A002 - the field's word
    output: Array,
) -> Array:
    """State before the first sample with which the plant best reproduces an output.

    Least squares over the whole stretch, with singular values that it does not determine left out.

    Parameters
    ----------
    model : PolynomialModel
        With a stable plant.
    input, output : (N,) arrays

    Returns
    -------
    (model.state_dimension,) array
        For :meth:`PolynomialModel.simulate`.
    """
    remainder = np.asarray(output, dtype=float) - model.simulate(input)
    columns = _delayed(model.plant_denominator, [1.0], model.state_dimension, len(remainder))
    return _fitted(columns, remainder)


def simulate_with_fitted_level(
    model: PolynomialModel,
    input: Array,  # noqa: A002
    output: Array,
) -> Array:
    """Simulation, (N,), from the initial state and the level with which it fits an output best.

    Least squares over the whole stretch.  The level takes the place of the model's own.

    Parameters
    ----------
    model : PolynomialModel
        With a stable plant.
    input, output : (N,) arrays
    """
    response = replace(model, level=0.0).simulate(input)
    remainder = np.asarray(output, dtype=float) - response
    state = _delayed(model.plant_denominator, [1.0], model.state_dimension, len(remainder))
    columns = np.column_stack([state, np.ones(len(remainder))])
    return np.asarray(response + columns @ _fitted(columns, remainder))


def estimate_prediction_states(
    model: PolynomialModel,
    input: Array,  # noqa: A002
    output: Array,
) -> tuple[Array, Array]:
    """Plant state (nf,) and noise state (max(nc, nd),) with the smallest prediction errors.

    Least squares over the whole stretch, for :meth:`PolynomialModel.residuals` and
    :meth:`PolynomialModel.predict`.

    Parameters
    ----------
    model : PolynomialModel
        Invertible.
    input, output : (N,) arrays
    """
    orders = model.orders
    residuals = model.residuals(input, output)[orders.first_residual :]
    through_plant = _delayed(np.convolve(model.c, model.f), model.d, orders.nf, len(residuals))
    through_noise = _delayed(model.c, [1.0], orders.noise_states, len(residuals))
    states = _fitted(np.column_stack([through_plant, through_noise]), -residuals)
    return states[: orders.nf], states[orders.nf :]


def estimate_level(
    model: PolynomialModel,
    input: Array,  # noqa: A002
    output: Array,
) -> float:
    """The level with which a model has the smallest prediction errors, states fitted as well.

    Least squares over the whole stretch; the level takes the place of the model's own.

    Parameters
    ----------
    model : PolynomialModel
        Invertible.
    input, output : (N,) arrays
    """
    from scipy.signal import lfilter

    orders = model.orders
    residuals = replace(model, level=0.0).residuals(input, output)[orders.first_residual :]
    columns = [
        lfilter(model.d, model.c, -np.ones(len(residuals)))[:, None],
        _delayed(np.convolve(model.c, model.f), model.d, orders.nf, len(residuals)),
        _delayed(model.c, [1.0], orders.noise_states, len(residuals)),
    ]
    return float(_fitted(np.column_stack(columns), -residuals)[0])


def _delayed(denominator: Array, numerator: Array | list[float], count: int, samples: int) -> Array:
    """Responses of a filter to impulses at samples 0, 1, ..., (samples, count)."""
    from scipy.signal import lfilter

    impulse = np.zeros(samples)
    impulse[0] = 1.0
    response = lfilter(numerator, denominator, impulse)
    columns = np.zeros((samples, count))
    for k in range(min(count, samples)):
        columns[k:, k] = response[: samples - k]
    return columns


def _fitted(columns: Array, target: Array) -> Array:
    if columns.shape[1] == 0:
        return np.empty(0)
    return np.asarray(np.linalg.lstsq(columns, target, rcond=1e-10)[0], dtype=float)
