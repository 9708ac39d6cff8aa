"""Starting models of state space by linear algebra.

All start from a long vector ARX model ``y = sum_k (G_k u_(t-k) + F_k y_(t-k)) + D u + constant``:

- canonical variates of its predictor (Jansson 2003, SSARX; Chiuso 2007), which gives A, B, C, K;
- its impulse response from the inputs, realised (Kung 1978), which gives the poles of a plant;
- instruments from the past (MOESP, Verhaegen 1994), which need no ARX model, give poles as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.scaled_record import StateSpaceRecord

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Share of a long ARX model's regressors by which their number of samples must exceed it.
SAMPLES_PER_REGRESSOR = 3
# Ridge of least squares, relative to the largest squared singular value: rounding.
RIDGE = 1e-13


@dataclass(frozen=True, eq=False)
class LongArx:
    """A vector ARX model: ``markov[k - 1] = [G_k, F_k]``, (lags, ny, nu + ny), D, (ny, nu)."""

    markov: Array
    feedthrough: Array
    errors: Array


def largest_lag(record: StateSpaceRecord) -> int:
    """Lags of a vector ARX model that the record supports."""
    signals = record.inputs.shape[1] + record.outputs.shape[1]
    shortest = int(np.min(np.diff(record.bounds)))
    return max(1, min(record.samples // (SAMPLES_PER_REGRESSOR * signals) - 1, shortest // 4))


def long_arx(record: StateSpaceRecord, lags: int) -> LongArx:
    """Vector ARX model by least squares."""
    u, y = record.inputs, record.outputs
    joint = np.column_stack([u, y])
    regressors, targets = [], []
    for first, stop in zip(record.bounds[:-1], record.bounds[1:], strict=True):
        rows = np.arange(first + lags, stop)
        past = np.hstack([joint[rows - k] for k in range(1, lags + 1)])
        regressors.append(np.hstack([past, u[rows], np.ones((len(rows), 1))]))
        targets.append(y[rows])
    x, target = np.concatenate(regressors), np.concatenate(targets)
    free = np.ones(x.shape[1], dtype=bool)
    width = joint.shape[1]
    free[lags * width : lags * width + u.shape[1]] = record.feedthrough
    free[-1] = record.levels
    gram = x[:, free].T @ x[:, free]
    gram[np.diag_indices_from(gram)] += RIDGE * np.trace(gram)
    solution = np.zeros((x.shape[1], y.shape[1]))
    solution[free] = np.linalg.solve(gram, x[:, free].T @ target)
    markov = solution[: lags * width].reshape(lags, width, -1).transpose(0, 2, 1)
    feedthrough = solution[lags * width : lags * width + u.shape[1]].T
    return LongArx(markov, feedthrough, target - x @ solution)


@dataclass(frozen=True, eq=False)
class PredictorModel:
    """``x+ = A x + B [u, y], yhat = C x + ...`` of scaled signals: A is that of the predictor."""

    A: Array
    B: Array
    C: Array


def canonical_variates(
    record: StateSpaceRecord, arx: LongArx, future: int, largest_order: int
) -> list[PredictorModel]:
    """Predictors of all orders 1 ... largest_order from states that predict the future best.

    Parameters
    ----------
    record : StateSpaceRecord
    arx : LongArx
    future : int
        Samples ahead whose predictions the states are chosen for.
    largest_order : int
    """
    u, y = record.inputs, record.outputs
    joint = np.column_stack([u, y])
    lags, ny, width = arx.markov.shape
    future = min(future, lags)
    # Row i: what the past adds to the prediction of y_(t+i), later values of u and y aside.
    weights = np.zeros((future * ny, lags * width))
    for i in range(future):
        for k in range(lags - i):
            weights[i * ny : (i + 1) * ny, k * width : (k + 1) * width] = arx.markov[k + i]
    noise = arx.errors.T @ arx.errors / len(arx.errors)
    whitener = np.linalg.inv(np.linalg.cholesky(noise + 1e-10 * np.eye(ny)))
    weights = (np.kron(np.eye(future), whitener)) @ weights
    pasts, nexts, rows_of = [], [], []
    for first, stop in zip(record.bounds[:-1], record.bounds[1:], strict=True):
        rows = np.arange(first + lags, stop - 1)
        pasts.append(np.hstack([joint[rows - k] for k in range(1, lags + 1)]))
        nexts.append(np.hstack([joint[rows + 1 - k] for k in range(1, lags + 1)]))
        rows_of.append(rows)
    past, following, rows = np.concatenate(pasts), np.concatenate(nexts), np.concatenate(rows_of)
    gram = past.T @ past
    _, vectors = np.linalg.eigh(weights @ gram @ weights.T)
    vectors = vectors[:, ::-1]
    largest = min(largest_order, vectors.shape[1])
    chosen = vectors[:, :largest].T @ weights
    states, next_states = past @ chosen.T, following @ chosen.T
    constant = np.ones((len(rows), int(record.levels)))
    models = []
    for order in range(1, largest + 1):
        x, ahead = states[:, :order], next_states[:, :order]
        now = np.column_stack([x, joint[rows], constant])
        dynamics = _least_squares(now, ahead).T
        outputs = np.column_stack([x, u[rows][:, record.feedthrough], constant])
        C = _least_squares(outputs, y[rows]).T[:, :order]
        models.append(PredictorModel(dynamics[:, :order], dynamics[:, order : order + width], C))
    return models


def realised_poles(record: StateSpaceRecord, arx: LongArx, largest_order: int) -> list[Complex]:
    """Poles of plants of orders 1 ... largest_order that realise a long model's impulse response.

    Empty for a record without input.
    """
    nu, ny = record.inputs.shape[1], record.outputs.shape[1]
    if nu == 0:
        return []
    lags = len(arx.markov)
    blocks = max(2 * (largest_order // min(ny, nu) + 2), 12)
    blocks = min(blocks, 60)
    response = np.zeros((2 * blocks, ny, nu))
    for t in range(2 * blocks):
        # Impulse response at lag t + 1.
        if t < lags:
            response[t] = arx.markov[t][:, :nu]
        for k in range(1, min(t + 1, lags) + 1):
            earlier = response[t - k] if t >= k else arx.feedthrough
            response[t] += arx.markov[k - 1][:, nu:] @ earlier
    if not np.isfinite(response).all() or np.abs(response).max() > 1e6:
        return []
    hankel = np.block([[response[i + j] for j in range(blocks)] for i in range(blocks)])
    left, values, _ = np.linalg.svd(hankel, full_matrices=False)
    scaled = left * np.sqrt(values)
    poles = []
    for order in range(1, min(largest_order, scaled.shape[1]) + 1):
        observability = scaled[:, :order]
        A = np.linalg.lstsq(observability[:-ny], observability[ny:], rcond=1e-12)[0]
        poles.append(np.asarray(np.linalg.eigvals(A), dtype=complex))
    return poles


def instrumental_poles(record: StateSpaceRecord, horizon: int, largest_order: int) -> list[Complex]:
    """Poles of orders 1 ... largest_order by MOESP with past inputs and outputs as instruments.

    The observability matrix is the part of the future outputs that past signals explain beyond
    the future inputs.
    """
    u, y = record.inputs, record.outputs
    nu, ny = u.shape[1], y.shape[1]
    joint = np.column_stack([u, y])
    future_u, future_y, past = [], [], []
    for first, stop in zip(record.bounds[:-1], record.bounds[1:], strict=True):
        rows = np.arange(first + horizon, stop - horizon)
        if len(rows) == 0:
            continue
        future_u.append(np.hstack([u[rows + k] for k in range(horizon)]))
        future_y.append(np.hstack([y[rows + k] for k in range(horizon)]))
        past.append(np.hstack([joint[rows - k] for k in range(1, horizon + 1)]))
    if not past:
        return []
    known = np.concatenate(future_u)
    if record.levels:
        known = np.column_stack([known, np.ones(len(known))])
    stacked = np.column_stack([known, np.concatenate(past), np.concatenate(future_y)])
    if len(stacked) < stacked.shape[1]:
        return []
    gram = stacked.T @ stacked
    gram[np.diag_indices_from(gram)] += RIDGE * np.trace(gram)
    lower = np.linalg.cholesky(gram)
    inputs, pasts = known.shape[1], horizon * (nu + ny)
    explained = lower[inputs + pasts :, inputs : inputs + pasts]
    left, values, _ = np.linalg.svd(explained, full_matrices=False)
    poles = []
    for order in range(1, min(largest_order, (horizon - 1) * ny) + 1):
        observability = left[:, :order] * np.sqrt(values[:order])
        A = np.linalg.lstsq(observability[:-ny], observability[ny:], rcond=1e-12)[0]
        poles.append(np.asarray(np.linalg.eigvals(A), dtype=complex))
    return poles


def _least_squares(regressors: Array, targets: Array) -> Array:
    gram = regressors.T @ regressors
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0.0] = 1.0
    gram = gram / np.outer(scale, scale)
    gram[np.diag_indices_from(gram)] += RIDGE * len(gram)
    solution: Array = np.linalg.solve(gram, (regressors.T @ targets) / scale[:, None])
    return solution / scale[:, None]
