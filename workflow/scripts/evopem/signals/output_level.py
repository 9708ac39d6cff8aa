"""The constant part of an output that responds to an input."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evopem.blas_threads import one_blas_thread

if TYPE_CHECKING:
    from evopem.signals.recording import Recording

Array = NDArray[np.float64]

# Lags of input and output in the regression, and the samples that each of them needs at least.
MOST_LAGS = 30
SAMPLES_PER_LAG = 20
# Rows of the regression that are held in memory at a time.
ROWS = 4096
# Quantile of the normal distribution that an estimate must exceed, two-sided 1 %.
NORMAL_99 = 2.576
# Diagonal elements of the triangle below this share of their column's length are rounding.
RANK_TOLERANCE = 1e-10


def output_level(recording: Recording) -> float:
    """Level of the output at which an input at its mean would hold it.

    The mean of the output is this level for a long record only. What the input before the record
    adds to its beginning, and what the response to its end lacks, shift the mean by about the
    memory of the system over the number of samples. That counts where the noise is weak: the
    innovations then have a mean that no noise model has, and the zeros of C move towards 1.

    A regression of the output on past inputs, past outputs and a constant is free of these ends
    (Ljung 1999, section 14.1). Its level takes the place of the mean where its constant differs
    from that of the mean, and its sum of output coefficients from zero, at 1 %: an output that
    drifts has no level.

    Parameters
    ----------
    recording : Recording
        The samples, in any unit.

    Returns
    -------
    float
        In the unit of the output.

    Examples
    --------
    A response of the gain 2 to noise, which has settled before the record and goes on after it:

    >>> from evopem.signals.recording import Recording
    >>> u, e = np.random.default_rng(1).standard_normal((2, 1100))
    >>> y = 3.0 + 2.0 * np.convolve(u, np.full(10, 0.1))[:1100] + 0.001 * e
    >>> truth = 3.0 + 2.0 * u[100:].mean()
    >>> level = output_level(Recording(u[100:], y[100:], 1.0))
    >>> bool(abs(level - truth) < 0.1 * abs(y[100:].mean() - truth))
    True
    """
    mean, deviation = float(recording.output.mean()), float(recording.output.std())
    lags = min(MOST_LAGS, recording.samples // SAMPLES_PER_LAG)
    if lags < 1 or not deviation > 0.0:
        return mean
    y = (recording.output - mean) / deviation
    u = recording.input - recording.input.mean()
    u /= np.std(u) or 1.0
    # The bits must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        shift = _shift(_triangle(u, y, lags), lags, recording.samples - lags)
    return mean + deviation * shift


def _triangle(u: Array, y: Array, lags: int) -> Array:
    """R of the QR decomposition of past outputs, present and past inputs, 1 and the output."""
    triangle = np.empty((0, 2 * lags + 3))
    for first in range(lags, len(y), ROWS):
        stop = min(first + ROWS, len(y))
        columns = [y[first - k : stop - k] for k in range(1, lags + 1)]
        columns += [u[first - k : stop - k] for k in range(lags + 1)]
        columns += [np.ones(stop - first), y[first:stop]]
        rows = np.vstack([triangle, np.column_stack(columns)])
        triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    return triangle


def _shift(triangle: Array, lags: int, rows: int) -> float:
    """How much the level lies above the mean, in standard deviations; 0 where it is not known."""
    count = triangle.shape[1] - 2  # of the coefficients beside the constant
    if len(triangle) < count + 2 or abs(triangle[count, count]) <= RANK_TOLERANCE * rows**0.5:
        return 0.0
    noise = abs(triangle[-1, -1]) / math.sqrt(rows - count - 1)
    if abs(triangle[count, -1]) <= NORMAL_99 * noise:
        return 0.0
    inverse = np.linalg.pinv(triangle[: count + 1, : count + 1], rcond=RANK_TOLERANCE)
    coefficients = inverse @ triangle[: count + 1, -1]
    total = 1.0 - float(coefficients[:lags].sum())
    error = noise * float(np.linalg.norm(inverse[:lags].sum(axis=0)))
    return float(coefficients[count]) / total if abs(total) > NORMAL_99 * error else 0.0
