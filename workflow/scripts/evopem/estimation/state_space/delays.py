"""Delays of the inputs, from vector ARX models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag

from evopem.blas_threads import one_blas_thread
from evopem.estimation.state_space.prepared import records_of

Array = NDArray[np.float64]

# Lags of the outputs, and lags of each input counted from its delay, at most.
OUTPUT_LAGS, INPUT_LAGS = 10, 10
# Rounds over the inputs; the choice hardly ever changes after the first one.
ROUNDS = 3
# Level of the test that the lags before a delay explain nothing.
SIGNIFICANCE = 0.05


def estimate_delays(
    inputs: ArrayLike | Sequence[ArrayLike],
    outputs: ArrayLike | Sequence[ArrayLike],
    largest: int | Sequence[int] = 10,
    smallest: int | Sequence[int] = 0,
) -> tuple[int, ...]:
    """Delay nk of each input in samples, 0 for one that acts on the same sample.

    Lags of a vector ARX model, of a fixed last lag, are left out from the first one on: as many as
    give the lowest BIC, as long as a likelihood ratio test does not find that those from 1 on
    explain something together.  BIC alone leaves out too many of them: each has a coefficient for
    every output there, but the lags of a state-space model have their states in common.  A delay
    that is too short costs a few states at most, and one that is too long distorts the response.
    Lag 0 has coefficients of its own in a state-space model as well, the matrix D.

    Parameters
    ----------
    inputs : (N, nu) array_like, or a list of them
        One record or several, each with a constant of its own.
    outputs : (N, ny) array_like, or a list of them
    largest, smallest : int or sequence of int
        Delays tried, both included, of all inputs or of each.

    Examples
    --------
    >>> u = np.random.default_rng(1).standard_normal((500, 2))
    >>> y = np.zeros((500, 1))
    >>> y[2:, 0] = u[2:, 0] + u[:-2, 1]
    >>> estimate_delays(u, y + 0.1 * np.random.default_rng(2).standard_normal((500, 1)))
    (0, 2)
    """
    us, ys = records_of(inputs, "inputs"), records_of(outputs, "outputs")
    samples, nu, ny = sum(map(len, ys)), us[0].shape[1], ys[0].shape[1]
    low, high = (np.broadcast_to(each, nu) for each in (smallest, largest))
    affordable = max((samples // 5 - ny) // (nu + ny), 1)
    last = min(int(high.max()) + INPUT_LAGS, affordable)
    high = np.maximum(np.minimum(high, last - 1), low)
    last = max(last, int(high.max()) + 1)
    output_lags = min(OUTPUT_LAGS, affordable)
    first = max(last, output_lags)
    parts = [_rows(u, y, first, last, output_lags) for u, y in zip(us, ys, strict=True)]
    lagged = [np.concatenate([part[1][j] for part in parts]) for j in range(nu)]
    constants = block_diag(*(np.ones((len(part[2]), 1)) for part in parts))
    known = np.column_stack([constants, np.concatenate([part[0] for part in parts])])
    targets = np.concatenate([part[2] for part in parts])
    with one_blas_thread():
        delays = low.tolist()
        for _ in range(ROUNDS):
            before = list(delays)
            for j in range(nu):
                whole = max(1 - low[j], 0)
                found = [
                    _fit(known, lagged, [*delays[:j], delay, *delays[j + 1 :]], targets)
                    for delay in range(low[j], high[j] + 1)
                ]
                possible = [
                    place
                    for place, fit in enumerate(found)
                    if place <= whole or fit.adds_nothing_to(found[whole], place - whole)
                ]
                delays[j] = int(low[j]) + min(possible, key=lambda place: found[place].bic)
            if delays == before:
                break
    return tuple(delays)


def _rows(
    u: Array, y: Array, first: int, last: int, output_lags: int
) -> tuple[Array, list[Array], Array]:
    """Past outputs, lags of each input, and outputs of a record from a sample on."""
    rows = np.arange(first, max(len(y), first))
    past = np.column_stack([y[rows - k] for k in range(1, output_lags + 1)])
    lagged = [np.column_stack([u[rows - k, j] for k in range(last + 1)]) for j in range(u.shape[1])]
    return past, lagged, y[rows]


@dataclass(frozen=True)
class _Fit:
    """Least squares of a vector ARX model.

    Attributes
    ----------
    log_determinant : float
        Of the covariance of the errors.
    count, outputs, regressors : int
        Of samples, of outputs, and of coefficients of each.
    """

    log_determinant: float
    count: int
    outputs: int
    regressors: int

    @property
    def bic(self) -> float:
        """Bayes' information criterion for each sample."""
        coefficients = self.regressors * self.outputs
        return self.log_determinant + coefficients * np.log(self.count) / self.count

    def adds_nothing_to(self, whole: _Fit, left_out: int) -> bool:
        """Whether regressors that are left out of a whole model explain nothing in it.

        Wilks' likelihood ratio with Bartlett's factor (Anderson 2003, section 8.5).
        """
        from scipy.stats import chi2

        factor = whole.count - whole.regressors - (whole.outputs - left_out + 1) / 2.0
        statistic = factor * (self.log_determinant - whole.log_determinant)
        return bool(chi2.sf(statistic, left_out * whole.outputs) > SIGNIFICANCE)


def _fit(known: Array, lagged: Sequence[Array], delays: Sequence[int], targets: Array) -> _Fit:
    x = np.column_stack([known, *(each[:, nk:] for each, nk in zip(lagged, delays, strict=True))])
    errors = targets - x @ np.linalg.lstsq(x, targets, rcond=None)[0]
    count, ny = targets.shape
    covariance = errors.T @ errors / count
    floor = 1e-14 * np.diag(np.mean(targets**2, axis=0) + np.finfo(float).tiny)
    return _Fit(float(np.linalg.slogdet(covariance + floor)[1]), count, ny, x.shape[1])
