"""What a pass over the record needs: the record, the objective and the buffers.

The recursions work through blocks of four samples, so records are padded to
:func:`padded_length`.  Parameters are stored *signed*: rows ``[a, -b, -c, d]``, with C padded by
zero coefficients to :data:`MIN_NC` rows, so that every term of a recursion is an addition.  ``d``,
as many rows as C has, is the noise state, the effect of the unknown noise before the record:
``d_i`` is added to the equation error of sample ``residual_start + i``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.cache import njit
from evopem.estimation.pem.kernels.simd import constant, lanes_table, store

BLOCK = 4
MIN_NC = BLOCK - 1
# Samples of a stretch, a multiple of two blocks: its buffers fit the first-level cache.
CHUNK = 128
# Residuals that are kept for a backward pass, a multiple of stretches: all of a record of this
# length, half of a longer one.  The others are computed again when the pass comes to them.
KEPT = 2**17


class Record(NamedTuple):
    """A record, the orders of the models that share a pass over it, and the samples that count.

    ``y`` and ``u`` are padded to :func:`padded_length`.  ``rows_c`` is nc, or :data:`MIN_NC` where
    that is more.  Residuals begin at ``residual_start`` (at least ``max(na, nb + nk - 1,
    MIN_NC)``); those at ``loss_start <= t < loss_stop`` are summed in the objective.
    """

    y: NDArray[np.float64]
    u: NDArray[np.float64]
    na: int
    nb: int
    nc: int
    nk: int
    rows_c: int
    residual_start: int
    loss_start: int
    loss_stop: int


class Objective(NamedTuple):
    """The objective of a sum of losses, and the stability region.

    ``absolute`` or else square loss, times ``factor``; ``state_weight`` times the square of the
    noise state is added.  Roots of A and C beyond ``max_root_radius`` are infeasible.
    """

    absolute: bool
    factor: float
    state_weight: float
    max_root_radius: float


class Workspace(NamedTuple):
    """Buffers of a pass, each a table with one column for each of the eight models.

    Parameters and gradient of the loaded models, the residuals of a part of the record with the
    ``rows_c`` before it, the last ``rows_c`` residuals before each part, one row each for the
    smoothing of the absolute value and for sums, a stretch of residuals or slopes, and stretches
    of signals filtered through 1/C.
    """

    parameters: NDArray[np.float64]
    gradient: NDArray[np.float64]
    residuals: NDArray[np.float64]
    ends: NDArray[np.float64]
    smoothing: NDArray[np.float64]
    total: NDArray[np.float64]
    window: NDArray[np.float64]
    filtered: NDArray[np.float64]


class LagSums(NamedTuple):
    """Buffers of the products of lagged signals: the record's two ends, and the sums."""

    heads: NDArray[np.float64]
    tails: NDArray[np.float64]
    sums: NDArray[np.float64]


def padded_length(samples: int, residual_start: int) -> int:
    """Length of a padded record, ``residual_start`` and a whole number of pairs of blocks."""
    return residual_start + 2 * BLOCK * -(-(samples - residual_start) // (2 * BLOCK))


def workspace_for(record: Record, kept: int = 0) -> Workspace:
    """Buffers for passes over a record that keep at least some residuals, by default half."""
    rows = record.na + record.nb + 2 * record.rows_c
    samples = len(record.y) - record.residual_start
    kept = max(kept or -(-samples // (2 * CHUNK)) * CHUNK, KEPT)
    return Workspace(
        parameters=lanes_table(rows),
        gradient=lanes_table(rows),
        residuals=lanes_table(record.rows_c + min(samples, kept)),
        ends=lanes_table((-(-samples // kept) + 1) * record.rows_c),
        smoothing=lanes_table(1),
        total=lanes_table(1),
        window=lanes_table(CHUNK + record.rows_c),
        filtered=lanes_table(5 * (CHUNK + _history(record))),
    )


def lag_sums_for(record: Record) -> LagSums:
    """Buffers for the products of lags."""
    rows = record.na + record.nb + 2 * record.rows_c
    ends = 4 * _history(record)
    return LagSums(lanes_table(ends), lanes_table(ends), lanes_table(rows * rows))


def _history(record: Record) -> int:
    """Rows of filtered signals that products of lags, four at a time, look back on."""
    return max(record.na, record.nb + record.nk, record.rows_c) + 4


@njit
def fill(table, begin, end, value):
    """Write one number to all lanes of the rows ``begin ... end - 1`` of a table."""
    lanes = constant(value)
    for row in range(begin, end):
        store(table, row, lanes)


@njit
def marked_rows(marked):
    """Indices of the true entries of a boolean array."""
    rows = np.empty(marked.size, dtype=np.intp)
    count = 0
    for r in range(marked.size):
        if marked[r]:
            rows[count] = r
            count += 1
    return rows[:count]


@njit
def all_finite(numbers):
    """Whether every number of an array is finite."""
    finite = True
    for i in range(numbers.size):
        finite &= np.isfinite(numbers[i])
    return finite


@njit
def load_points(record, points, rows, parameters):
    """Signed parameters of up to eight rows of a population, one in each lane, others zero."""
    noise = record.na + record.nb
    fill(parameters, 0, parameters.shape[0], 0.0)
    for lane, r in enumerate(rows):
        for i in range(record.na):
            parameters[i, lane] = points[r, i]
        for i in range(record.na, noise + record.nc):
            parameters[i, lane] = -points[r, i]
        for k in range(record.nc):
            parameters[noise + record.rows_c + k, lane] = points[r, noise + record.nc + k]


@njit
def load_smoothing(smoothing, rows, workspace):
    """The smoothing widths of the loaded models' absolute values, 1 in the lanes left over."""
    store(workspace.smoothing, 0, constant(1.0))
    for lane, r in enumerate(rows):
        workspace.smoothing[0, lane] = smoothing[r]


@njit
def squared_state(record, point):
    """Sum of the squares of a point's noise state."""
    square = 0.0
    for k in range(record.na + record.nb + record.nc, point.size):
        square += point[k] * point[k]
    return square
