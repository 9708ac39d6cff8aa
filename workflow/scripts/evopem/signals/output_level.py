"""The constant part of outputs that respond to inputs."""

import math

import numpy as np

from evopem.arrays import Array
from evopem.blas_threads import one_blas_thread
from evopem.signals.recording import Recording

# Lags of inputs and output in the regression, and the samples that a coefficient needs at least.
MOST_LAGS = 30
SAMPLES_PER_COEFFICIENT = 10
# Rows of the regression that are held in memory at a time.
ROWS = 4096
# Quantile of the normal distribution that an estimate must exceed, two-sided 1 %.
NORMAL_99 = 2.576
# Diagonal elements of the triangle below this share of their column's length are rounding.
RANK_TOLERANCE = 1e-10


def output_levels(recording: Recording) -> tuple[float, ...]:
    """Level of each output at which inputs at their means would hold it, in its unit.

    What the inputs before a short record add to its beginning shifts the mean. A regression on past
    inputs, past outputs and a constant is free of it (Ljung 1999, section 14.1). Its level takes
    the place of the mean where it differs at 1 % and the output does not drift.
    """
    u = recording.inputs - recording.inputs.mean(axis=0)
    deviations = u.std(axis=0)
    u = u[:, deviations > 0.0] / deviations[deviations > 0.0]
    starts = recording.segment_starts[1:]
    return tuple(_level(u, np.ascontiguousarray(y), starts) for y in recording.outputs.T)


def _level(u: Array, output: Array, starts: tuple[int, ...]) -> float:
    mean, deviation = float(output.mean()), float(output.std())
    coefficients = 1 + max(u.shape[1], 1)
    lags = min(MOST_LAGS, len(output) // (coefficients * SAMPLES_PER_COEFFICIENT))
    if lags < 1 or not deviation > 0.0:
        return mean
    segments = zip(np.split(u, starts), np.split((output - mean) / deviation, starts), strict=True)
    # The bits must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        triangle = np.empty((0, lags + u.shape[1] * (lags + 1) + 2))
        for segment in segments:
            triangle = regression_triangle(*segment, lags, triangle)
        return mean + deviation * _shift(triangle, lags, len(output) - lags * (1 + len(starts)))


def regression_triangle(u: Array, y: Array, lags: int, before: Array | None = None) -> Array:
    """R of the QR decomposition of past outputs, present and past inputs, 1 and the output.

    ``before`` is that of other samples, to which these are added.
    """
    triangle = np.empty((0, lags + u.shape[1] * (lags + 1) + 2)) if before is None else before
    for first in range(lags, len(y), ROWS):
        stop = min(first + ROWS, len(y))
        columns = [y[first - k : stop - k] for k in range(1, lags + 1)]
        columns += [signal[first - k : stop - k] for signal in u.T for k in range(lags + 1)]
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
