"""Which of two channels drives the other: a test of prediction in both directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.blas_threads import one_blas_thread

Array = NDArray[np.float64]

# Largest order of the regressions, and samples for each of their orders at least.
MOST_LAGS, SAMPLES_PER_LAG = 30, 20
# First samples of a long recording that are enough.
MOST_SAMPLES = 10_000
# Level of both tests.
SIGNIFICANCE = 0.001


@dataclass(frozen=True)
class CausalityTest:
    """Whether the past of one channel improves predictions of the other, in both directions.

    Attributes
    ----------
    forward, backward : float
        p-values of the first channel's past in predictions of the second, and the reverse; NaN
        where the recording is too short.
    lags : int
        Order of the regressions.
    """

    forward: float
    backward: float
    lags: int

    @property
    def direction(self) -> int:
        """1 where the first channel drives the second, -1 for the reverse, 0 where neither is sure.

        One direction is significant and the other is not.
        """
        forward, backward = self.forward < SIGNIFICANCE, self.backward < SIGNIFICANCE
        return int(forward) - int(backward)


def causality_test(first: Array, second: Array) -> CausalityTest:
    """F-tests of the past of either channel in a regression of the other on its own past.

    An input that no feedback reaches is predicted from its own past as well as from both, and an
    output is not (Granger 1969).  BIC of both regressions together chooses their order.

    Parameters
    ----------
    first, second : (N,) arrays

    Examples
    --------
    >>> u, e = np.random.default_rng(1).standard_normal((2, 400))
    >>> y = np.convolve(u, [0.0, 1.0, 0.5])[:400] + e
    >>> causality_test(u, y).direction, causality_test(y, u).direction
    (1, -1)
    """
    from scipy.special import fdtrc

    signals = [_standardized(each[:MOST_SAMPLES]) for each in (first, second)]
    samples = len(signals[0])
    most = min(MOST_LAGS, samples // SAMPLES_PER_LAG)
    if most < 1:
        return CausalityTest(np.nan, np.nan, 0)
    with one_blas_thread():
        pairs = ((signals[1], signals[0]), (signals[0], signals[1]))
        triangles = [_triangle(target, other, most) for target, other in pairs]
        rows = samples - most
        criteria = [
            sum(
                np.log(max(_remainders(each, lags, most)[1], 1e-300))
                + 2 * lags * np.log(rows) / rows
                for each in triangles
            )
            for lags in range(1, most + 1)
        ]
        lags = int(np.argmin(criteria)) + 1
        found = []
        for each in triangles:
            own, both = _remainders(each, lags, most)
            freedom = rows - 2 * lags - 1
            statistic = (own - both) / lags / max(both / freedom, 1e-300)
            found.append(float(fdtrc(lags, freedom, max(statistic, 0.0))))
    return CausalityTest(found[0], found[1], lags)


def _standardized(signal: Array) -> Array:
    centred = np.asarray(signal - np.mean(signal), dtype=float)
    return centred / (float(np.std(centred)) or 1.0)


def _triangle(target: Array, other: Array, most: int) -> Array:
    """R of the QR decomposition of a constant, past targets, past others and the target."""
    samples = len(target)
    columns = [np.ones(samples - most)]
    for signal in (target, other):
        columns += [signal[most - lag : samples - lag] for lag in range(1, most + 1)]
    columns.append(target[most:])
    return np.asarray(np.linalg.qr(np.column_stack(columns), mode="r"))


def _remainders(triangle: Array, lags: int, most: int) -> tuple[float, float]:
    """Sums of squares left by the target's own past, and by both."""
    left = []
    own = list(range(lags + 1))
    for kept in (own, own + list(range(most + 1, most + 1 + lags))):
        rest = triangle[:, -1]
        solution = np.linalg.lstsq(triangle[:, kept], rest, rcond=1e-12)[0]
        left.append(float(np.sum((rest - triangle[:, kept] @ solution) ** 2)))
    return left[0], left[1]
