"""Marginal likelihood of each delay of an input, of predictors whose coefficients have a prior.

An output is predicted from its past and from lags of the input behind the delay.  The coefficients
are normal and decay, by kernels of largest marginal likelihood (Pillonetto, Chiuso & De Nicolao
2011).
"""

from collections.abc import Sequence

import numpy as np

from evopem.arrays import Array
from evopem.estimation.impulse_response import Evidence, tuned_correlated

# Past outputs and lags of the input in a predictor.
PAST, LAGS = 40, 100
# Hyper-parameters are searched for delays so far apart.  Those between take over the likelier ones
# of both, and search where that comes so near to the lowest value, as twice a logarithm.
APART, NEAR = 16, 10.0


def delay_evidence(past: Array, lagged: Array, target: Array, samples: int, delays: range) -> Array:
    """Minus twice the logarithm of the marginal likelihood of each delay, but for a constant.

    Those far above the lowest one are upper bounds.

    Parameters
    ----------
    past, lagged, target : array
        Past outputs (k, p), lags of the input from 0 on (k, n), and the output (k,), reduced to as
        many rows as needed.
    samples : int
        That the rows stand for.
    delays : range
        Those that are compared.
    """
    size = float(np.linalg.norm(target))
    if size == 0.0:
        return np.zeros(len(delays))
    evidences = []
    for delay in delays:
        columns = _unit(past), _unit(lagged)[:, delay : delay + LAGS], target[:, None] / size
        r: Array = np.asarray(np.linalg.qr(np.hstack(columns), mode="r"))
        blocks = r[:, : past.shape[1]], r[:, past.shape[1] : -1]
        evidences.append(Evidence(blocks, r[:, -1], samples))
    return _lowest(evidences) + 2.0 * samples * np.log(size)


def _unit(columns: Array) -> Array:
    """Columns over their mean length."""
    length = float(np.linalg.norm(columns)) / np.sqrt(columns.shape[1])
    return columns / (length or 1.0)


def _lowest(evidences: Sequence[Evidence]) -> Array:
    """The lowest value of each of them, where it comes near to the lowest of all."""
    values, searched = np.full(len(evidences), np.inf), dict[int, Array]()

    def search(k: int, starts: Sequence[Array]) -> None:
        value, hyper = evidences[k].descended(tuned_correlated, starts)
        values[k], searched[k] = min(value, values[k]), hyper.reshape(2, -1)

    ends = [*range(0, len(evidences) - 1, APART), len(evidences) - 1]
    for k in ends:
        search(k, [*evidences[k].starts(), *list(searched.values())[-1:]])
    for k, evidence in enumerate(evidences):
        for end in (end for end in ends if abs(end - k) < APART):
            value, _ = evidence.value(tuned_correlated, searched[end].ravel())
            values[k] = min(value, values[k])
    while True:
        near = [k for k in np.argsort(values).tolist() if values[k] < values.min() + NEAR]
        waiting = [k for k in near if k not in searched]
        if not waiting:
            return values
        search(waiting[0], [searched[min(searched, key=lambda k: abs(k - waiting[0]))]])
