"""Estimates of state-space models by linear algebra, for all orders and both forms at once.

From a long vector ARX model: canonical variates of its predictor (Jansson 2003; Chiuso 2007), and
its impulse response, realised (Kung 1978), for the poles of a plant; poles also by instruments from
the past (MOESP, Verhaegen 1994).
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from evopem.arrays import Array, Complex, Indices
from evopem.estimation.state_space.errors import StateSpaceErrors
from evopem.estimation.state_space.scaled_recording import ScaledRecording
from evopem.estimation.state_space.starting_points import from_matrices, from_poles, ridge

# Lags of the long ARX models, and horizons of the instrumental estimates.
LAGS = (8, 20, 50)
HORIZONS = (10, 25)
USUAL_ORDER = 20  # largest order of most recordings
# Share of a long ARX model's regressors by which their number of samples must exceed it.
SAMPLES_PER_REGRESSOR = 3
RIDGE = 1e-13  # ridge of least squares, relative to the largest squared singular value: rounding
# Block rows of the Hankel matrix of an impulse response, and its largest entry.
FEWEST_BLOCKS, MOST_BLOCKS, LARGEST_RESPONSE = 12, 60, 1e6

# ``x+ = A x + B [u, y], yhat = C x + ...`` of scaled signals, A that of the predictor.
Predictor = tuple[Array, Array, Array]
_Estimates = tuple[list[list[Predictor]], list[list[Complex]]]


class StartingModels:
    """Estimates of one recording; thorough ones take several lags and horizons instead of one."""

    def __init__(self, errors: StateSpaceErrors, largest_order: int, thorough: bool) -> None:
        self._data, self._thorough = errors.data, thorough
        self._inputs = errors.data.inputs.shape[1]
        self._largest = largest_order
        self._made: dict[int, _Estimates] = {}

    def points(self, errors: StateSpaceErrors) -> Iterator[Array]:
        """Points of the order and form of a problem."""
        at = errors.order - 1
        # The longer lags of large orders only where they are needed.
        usual = min(self._largest, USUAL_ORDER)
        largest = self._largest if errors.order > USUAL_ORDER else usual
        if largest not in self._made:
            self._made[largest] = self._made_for(largest)
        predictors, poles_of_orders = self._made[largest]
        for models in predictors:
            if at >= len(models):
                continue
            A, B, C = models[at]
            if not errors.innovations:
                A, B = A + B[:, self._inputs :] @ C, B[:, : self._inputs]
            yield from_matrices(errors, A, B)
            yield from_poles(errors, np.asarray(np.linalg.eigvals(A), dtype=complex))
        for poles in poles_of_orders:
            if at < len(poles) and not errors.innovations:
                yield from_poles(errors, poles[at])

    def _made_for(self, largest_order: int) -> _Estimates:
        """Predictors and poles of all orders."""
        data, thorough = self._data, self._thorough
        outputs = data.outputs.shape[1]
        least = -(-largest_order // outputs) + 2
        # Lags of a vector ARX model that the recording supports.
        most = data.samples // (SAMPLES_PER_REGRESSOR * (self._inputs + outputs)) - 1
        most = max(1, min(most, int(np.min(np.diff(data.bounds))) // 4))
        lags = sorted({min(max(lag, least), most) for lag in LAGS})
        if not thorough:
            lags = lags[len(lags) // 2 : len(lags) // 2 + 1]
        predictors, poles = [], []
        for lag in lags:
            arx = long_arx(data, lag)
            future = min(lag, max(10, least))
            predictors.append(canonical_variates(data, arx, future, largest_order))
            if thorough:
                poles.append(realised_poles(data, arx, largest_order))
        for horizon in HORIZONS if thorough else ():
            longest = (data.samples // (2 * self._inputs + 2 * outputs)) // 3
            wanted = min(max(horizon, least + 1), longest)
            if wanted > 2:
                poles.append(instrumental_poles(data, wanted, largest_order))
        return predictors, poles


class LongArx(NamedTuple):
    """A vector ARX model by least squares."""

    markov: Array  # [k - 1] = [G_k, F_k], (lags, l, m + l)
    feedthrough: Array  # D, (l, m)
    errors: Array


def _rows(data: ScaledRecording, before: int, after: int) -> Indices:
    """Samples with as many others of their segment before and after them."""
    parts = [np.arange(first + before, stop - after) for first, stop in pairwise(data.bounds)]
    return np.concatenate(parts)


def _past(signals: Array, rows: Indices, lags: int) -> Array:
    """Signals at lags 1 ... ``lags`` of some samples, (rows, lags signals)."""
    return np.hstack([signals[rows - k] for k in range(1, lags + 1)])


def long_arx(data: ScaledRecording, lags: int) -> LongArx:
    """That of some lags."""
    u, y = data.inputs, data.outputs
    joint = np.column_stack([u, y])
    rows, width = _rows(data, lags, 0), joint.shape[1]
    x = np.hstack([_past(joint, rows, lags), u[rows], np.ones((len(rows), 1))])
    free = np.ones(x.shape[1], dtype=bool)
    free[lags * width : lags * width + u.shape[1]] = data.feedthrough
    free[-1] = data.levels > 0
    gram = x[:, free].T @ x[:, free]
    gram[np.diag_indices_from(gram)] += RIDGE * np.trace(gram)
    solution = np.zeros((x.shape[1], y.shape[1]))
    solution[free] = np.linalg.solve(gram, x[:, free].T @ y[rows])
    markov = solution[: lags * width].reshape(lags, width, -1).transpose(0, 2, 1)
    feedthrough = solution[lags * width : lags * width + u.shape[1]].T
    return LongArx(markov, feedthrough, y[rows] - x @ solution)


def canonical_variates(
    data: ScaledRecording, arx: LongArx, future: int, largest_order: int
) -> list[Predictor]:
    """Predictors of orders 1 ... largest_order from states that predict ``future`` samples best."""
    u, y = data.inputs, data.outputs
    joint = np.column_stack([u, y])
    lags, outputs, width = arx.markov.shape
    future = min(future, lags)
    # Row i: what the past adds to the prediction of y_(t+i), later values of u and y aside.
    weights = np.zeros((future * outputs, lags * width))
    for i in range(future):
        for k in range(lags - i):
            block = weights[i * outputs : (i + 1) * outputs, k * width : (k + 1) * width]
            block[:] = arx.markov[k + i]
    noise = arx.errors.T @ arx.errors / len(arx.errors)
    whitener = np.linalg.inv(np.linalg.cholesky(noise + 1e-10 * np.eye(outputs)))
    weights = np.kron(np.eye(future), whitener) @ weights
    rows = _rows(data, lags, 1)
    past, following = _past(joint, rows, lags), _past(joint, rows + 1, lags)
    _, vectors = np.linalg.eigh(weights @ (past.T @ past) @ weights.T)
    largest = min(largest_order, vectors.shape[1])
    chosen = vectors[:, ::-1][:, :largest].T @ weights
    states, next_states = past @ chosen.T, following @ chosen.T
    constant = np.ones((len(rows), int(data.levels > 0)))
    models = []
    for order in range(1, largest + 1):
        x, ahead = states[:, :order], next_states[:, :order]
        dynamics = _least_squares(np.column_stack([x, joint[rows], constant]), ahead).T
        seen = np.column_stack([x, u[rows][:, data.feedthrough], constant])
        C = _least_squares(seen, y[rows]).T[:, :order]
        models.append((dynamics[:, :order], dynamics[:, order : order + width], C))
    return models


def realised_poles(data: ScaledRecording, arx: LongArx, largest_order: int) -> list[Complex]:
    """Poles of plants of orders 1 ... largest_order that realise its impulse response."""
    m, outputs = data.inputs.shape[1], data.outputs.shape[1]
    if m == 0:
        return []
    lags = len(arx.markov)
    blocks = max(2 * (largest_order // min(outputs, m) + 2), FEWEST_BLOCKS)
    blocks = min(blocks, MOST_BLOCKS)
    response = np.zeros((2 * blocks, outputs, m))
    for t in range(2 * blocks):
        # Impulse response at lag t + 1.
        if t < lags:
            response[t] = arx.markov[t][:, :m]
        for k in range(1, min(t + 1, lags) + 1):
            earlier = response[t - k] if t >= k else arx.feedthrough
            response[t] += arx.markov[k - 1][:, m:] @ earlier
    if not np.isfinite(response).all() or np.abs(response).max() > LARGEST_RESPONSE:
        return []
    hankel = np.block([[response[i + j] for j in range(blocks)] for i in range(blocks)])
    left, values, _ = np.linalg.svd(hankel, full_matrices=False)
    return _shift_poles(left * np.sqrt(values), outputs, largest_order)


def instrumental_poles(data: ScaledRecording, horizon: int, largest_order: int) -> list[Complex]:
    """Poles of orders 1 ... largest_order by MOESP with past inputs and outputs as instruments."""
    u, y = data.inputs, data.outputs
    m, outputs = u.shape[1], y.shape[1]
    rows = _rows(data, horizon, horizon)
    known = np.hstack([u[rows + k] for k in range(horizon)])
    if data.levels:
        known = np.column_stack([known, np.ones(len(known))])
    past = _past(np.column_stack([u, y]), rows, horizon)
    stacked = np.column_stack([known, past, *(y[rows + k] for k in range(horizon))])
    if len(stacked) < stacked.shape[1]:
        return []
    gram = stacked.T @ stacked
    gram[np.diag_indices_from(gram)] += RIDGE * np.trace(gram)
    lower = np.linalg.cholesky(gram)
    inputs, pasts = known.shape[1], horizon * (m + outputs)
    explained = lower[inputs + pasts :, inputs : inputs + pasts]
    left, values, _ = np.linalg.svd(explained, full_matrices=False)
    largest = min(largest_order, (horizon - 1) * outputs)
    return _shift_poles(left * np.sqrt(values), outputs, largest)


def _shift_poles(observability: Array, outputs: int, largest_order: int) -> list[Complex]:
    """Poles of orders 1 ... largest_order by the shift invariance of an observability matrix."""
    poles = []
    for order in range(1, min(largest_order, observability.shape[1]) + 1):
        seen = observability[:, :order]
        A = np.linalg.lstsq(seen[:-outputs], seen[outputs:], rcond=1e-12)[0]
        poles.append(np.asarray(np.linalg.eigvals(A), dtype=complex))
    return poles


def _least_squares(regressors: Array, targets: Array) -> Array:
    products = regressors.T @ targets
    return ridge(regressors.T @ regressors, products, RIDGE * regressors.shape[1])
