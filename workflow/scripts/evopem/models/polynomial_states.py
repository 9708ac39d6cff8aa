"""Initial states of polynomial models, from a stretch of measured signals."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel

Array = NDArray[np.float64]

FIRST_SHARE = 0.1
"""Share of a recording without a past that determines the state of its simulation."""

# Singular values below the first share of the largest one are left out, and more of them where the
# errors are larger than the fit says by this factor: a filter with clustered poles amplifies
# rounding.
RANKS, ROUNDING = (1e-10, 1e-7, 1e-4), 1.01
# Iterations of reweighted least squares towards least absolute deviations.
REWEIGHTINGS = 5


def first_samples(samples: int) -> int:
    """How many of the samples of a recording without a past determine its state."""
    return max(round(FIRST_SHARE * samples), 1)


def estimate_simulation_state(
    model: PolynomialModel,
    input: Array,  # noqa: A002 - the field's word
    output: Array,
) -> Array:
    """State before the first sample with which the plant best reproduces an output.

    Least squares over the whole stretch, with singular values that it does not determine left out.

    ``model``: with a stable plant.  ``input`` (N,) or (N, m), ``output`` (N,).  Returns
    (model.state_dimension,): for :meth:`PolynomialModel.simulate`.
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

    ``model``: with a stable plant.  ``input`` (N,) or (N, m), ``output`` (N,).
    """
    response = replace(model, level=0.0).simulate(input)
    remainder = np.asarray(output, dtype=float) - response
    state = _delayed(model.plant_denominator, [1.0], model.state_dimension, len(remainder))
    columns = np.column_stack([state, np.ones(len(remainder))])
    return np.asarray(response + columns @ _fitted(columns, remainder))


def simulate_from_first(
    model: PolynomialModel,
    input: Array,  # noqa: A002
    output: Array,
    known: int,
    free_level: bool = False,
    robust: bool = False,
) -> Array:
    """Simulation, (N,), from the initial state that the first outputs make most probable.

    Of normal states with the second moments of a simulation from rest, in noise of the size that
    the least-squares state leaves over the first outputs: a state that they hardly determine, as of
    poles that zeros nearly cancel, stays small instead of growing over the samples behind them.

    ``input`` (N,) or (N, m), ``output`` (N,).  ``known``: samples whose outputs count, at least 1.
    ``free_level``: whether a constant is fitted to the first outputs as well.  ``robust``: whether
    the state has the least absolute instead of the least squared errors.
    """
    from scipy.signal import lfilter

    a, n = model.plant_denominator, len(output)
    with np.errstate(all="ignore"):
        rest = replace(model, level=0.0).simulate(input)
        response = rest + lfilter([model.level], model.A, np.ones(n))
    count = min(model.state_dimension, n - 1)
    states = _delayed(a, [1.0], count, n)
    columns = np.column_stack([states, np.ones((n, int(free_level)))])
    if not (np.isfinite(columns).all() and np.isfinite(response).all()):
        return np.full(n, np.inf)
    if columns.shape[1] == 0:
        return np.asarray(response)
    target, fitted = (output - response)[:known], columns[:known]
    left = target - fitted @ _fitted(fitted, target)
    freedom = known - columns.shape[1]
    variance = float(left @ left) / freedom if freedom >= count else float(np.mean(target**2))
    prior = np.zeros((count, columns.shape[1]))
    if count and variance > 1e-20 * float(np.mean(target**2)):
        moments, directions = np.linalg.eigh(
            _driven_moments(model, np.reshape(input, (n, -1)), rest, count)
        )
        size = np.sqrt(np.maximum(moments, 1e-12 * max(moments[-1], 1e-300)))
        prior[:, :count] = np.sqrt(variance) * (directions / size).T
    return np.asarray(response + columns @ fitted_state(fitted, target, robust, prior))


def fitted_state(
    columns: Array, target: Array, robust: bool = False, prior: Array | None = None
) -> Array:
    """Least squares, or by reweighting nearly least absolute errors, (K,).

    ``columns`` (N, K), ``target`` (N,), ``prior`` (M, K): further rows, of target 0, that are not
    reweighted.
    """
    further = np.zeros((0, columns.shape[1])) if prior is None else prior
    weights = np.ones(len(target))
    for _ in range(REWEIGHTINGS + 1 if robust else 1):
        rows = np.vstack([columns * weights[:, None], further])
        found = _fitted(rows, np.concatenate([target * weights, np.zeros(len(further))]))
        size = np.abs(target - columns @ found)
        weights = 1.0 / np.sqrt(np.maximum(size, 0.1 * np.mean(size) + 1e-300))
    return found


def _driven_moments(model: PolynomialModel, inputs: Array, rest: Array, count: int) -> Array:
    """Second moments of what the past adds to the next ``count`` equations, (count, count)."""

    def padded(polynomial: Array) -> Array:
        return np.pad(polynomial, (0, max(count + 1 - len(polynomial), 0)))

    a = padded(model.plant_denominator)
    b = np.zeros((model.inputs, len(a)))
    for place, of_input in enumerate(model.B):
        others = [f for other, f in enumerate(model.F) if other != place]
        numerator = reduce(np.convolve, others, np.append(np.zeros(model.nk[place]), of_input))
        b[place, : len(numerator)] = numerator
    states = np.zeros((len(rest), count + 1))
    for k in range(count - 1, -1, -1):
        states[1:, k] = inputs[:-1] @ b[:, k + 1] - a[k + 1] * rest[:-1] + states[:-1, k + 1]
    states = states[:, :count]
    return np.asarray(states.T @ states / len(rest))


def estimate_prediction_states(
    model: PolynomialModel,
    input: Array,  # noqa: A002
    output: Array,
) -> tuple[Array, Array]:
    """Plant state (nf,) and noise state (max(nc, nd),) with the smallest prediction errors.

    Least squares over the whole stretch, for :meth:`PolynomialModel.residuals` and
    :meth:`PolynomialModel.predict`; never worse than states at rest.

    ``model``: invertible.  ``input`` (N,) or (N, m), ``output`` (N,).
    """
    orders = model.orders
    residuals = model.residuals(input, output)[orders.first_residual :]
    columns, plant = _through_states(model, len(residuals)), sum(orders.nf)
    rest = np.zeros(columns.shape[1])
    best, lowest = rest, float(residuals @ residuals)
    for rcond in RANKS:
        states = _fitted(columns, -residuals, rcond)
        expected = residuals + columns @ states
        found = model.residuals(input, output, states[:plant], states[plant:])
        reached = float(np.sum(found[orders.first_residual :] ** 2))
        if reached < lowest:
            best, lowest = states, reached
        if reached <= ROUNDING * float(expected @ expected):
            break
    return best[:plant], best[plant:]


def _through_states(model: PolynomialModel, samples: int) -> Array:
    """Residuals after an initial state of one at each state of plant and noise, (samples, K)."""
    of_plant = [_delayed(np.convolve(model.C, f), model.D, len(f) - 1, samples) for f in model.F]
    of_noise = _delayed(model.C, [1.0], model.orders.noise_states, samples)
    return np.column_stack([*of_plant, of_noise])


def estimate_level(
    model: PolynomialModel,
    input: Array,  # noqa: A002
    output: Array,
) -> float:
    """The level with which a model has the smallest prediction errors, states fitted as well.

    Least squares over the whole stretch; the level takes the place of the model's own.

    ``model``: invertible.  ``input`` (N,) or (N, m), ``output`` (N,).
    """
    from scipy.signal import lfilter

    orders = model.orders
    residuals = replace(model, level=0.0).residuals(input, output)[orders.first_residual :]
    columns = [
        lfilter(model.d, model.c, -np.ones(len(residuals)))[:, None],
        _through_states(model, len(residuals)),
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


def _fitted(columns: Array, target: Array, rcond: float = RANKS[0]) -> Array:
    if columns.shape[1] == 0:
        return np.empty(0)
    return np.asarray(np.linalg.lstsq(columns, target, rcond=rcond)[0], dtype=float)
