"""Initial states of polynomial models, from a stretch of measured signals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel

Array = NDArray[np.float64]

# Singular values below the first share of the largest one are left out, and more of them where the
# errors are larger than the fit says by this factor: a filter with clustered poles amplifies
# rounding.
RANKS, ROUNDING = (1e-10, 1e-7, 1e-4), 1.01


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
