"""Gauss-Newton matrices from products of lagged, filtered signals."""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit, inlined, njit
from evopem.estimation.pem.kernels.record import (
    BLOCK,
    CHUNK,
    fill,
    load_points,
    load_smoothing,
)
from evopem.estimation.pem.kernels.residuals import (
    filter_block,
    kept_residuals,
    residuals_of_part,
    sum_of_losses,
)
from evopem.estimation.pem.kernels.simd import (
    LANES,
    add,
    constant,
    divide,
    fma,
    load,
    sample,
    square_root,
    store,
)
from evopem.estimation.pem.kernels.stability import barrier_curvature

# Magnitude below which an impulse response has died out.
DECAYED = 1e-100


@njit
def _counted_rows(record, begin, end):
    """Rows of the residuals of a part that the loss counts."""
    before = begin - record.rows_c
    return max(begin, record.loss_start) - before, min(end, record.loss_stop) - before


@njit
def _mean_second_derivatives(record, workspace, bandwidth):
    """Mean second derivative of ``sqrt(e**2 + width**2)`` over the residuals, to ``total``.

    Twice a kernel estimate of their density at zero, ``width`` being ``bandwidth`` in mean ``|e|``
    but no narrower than the smoothing.
    """
    zero = constant(0.0)
    count = record.loss_stop - record.loss_start
    parts = kept_residuals(record, workspace)[1]
    s = zero
    for part in range(parts):
        begin, end = residuals_of_part(record, workspace, part)
        first, last = _counted_rows(record, begin, end)
        s = sum_of_losses(workspace.residuals, True, first, last, s)
    store(workspace.total, 0, s)
    for lane in range(LANES):
        width = bandwidth * workspace.total[0, lane] / count
        workspace.total[0, lane] = max(width, workspace.smoothing[0, lane])
    width_squared = fma(load(workspace.total, 0), load(workspace.total, 0), zero)
    s = zero
    for part in range(parts):
        if parts > 1:
            begin, end = residuals_of_part(record, workspace, part)
        first, last = _counted_rows(record, begin, end)
        for row in range(first, last):
            v = load(workspace.residuals, row)
            r = fma(v, v, width_squared)
            s = add(s, divide(width_squared, fma(r, square_root(r), zero)))
    store(workspace.total, 0, s)
    for lane in range(LANES):
        workspace.total[0, lane] /= count


@njit
def _inverse_filter(parameters, c, nc, source, source_row, size, filtered, filtered_row):
    """Filter ``size`` rows of a table through 1/C; the nc rows before the first are known."""
    for i in range(0, size, BLOCK):
        row = source_row + i
        s0, s1 = load(source, row), load(source, row + 1)
        s2, s3 = load(source, row + 2), load(source, row + 3)
        filter_block(parameters, c, nc, s0, s1, s2, s3, filtered, filtered_row + i)


@njit
def _filter_signals(record, workspace, before, begin, end, segment, history):
    """A stretch of ``y``, ``u``, ``e`` and an impulse at the start, filtered through 1/C.

    Row ``t - before`` of the residuals is sample t.
    """
    table, source, size = workspace.filtered, 4 * segment, end - begin
    c, nc = record.na + record.nb, record.rows_c
    parameters = workspace.parameters
    for t in range(begin, end):
        store(table, source + t - begin, sample(record.y, t))
    _inverse_filter(parameters, c, nc, table, source, size, table, history)
    for t in range(begin, end):
        store(table, source + t - begin, sample(record.u, t))
    _inverse_filter(parameters, c, nc, table, source, size, table, segment + history)
    e, row = workspace.residuals, begin - before
    _inverse_filter(parameters, c, nc, e, row, size, table, 2 * segment + history)
    for t in range(begin, end):
        store(table, source + t - begin, constant(1.0 if t == record.residual_start else 0.0))
    _inverse_filter(parameters, c, nc, table, source, size, table, 3 * segment + history)


@njit
def _add_products(table, x, z, size, count, sums, row, stride):
    """``sums[row + j stride] += sum_i table[x + i] table[z + i - j]`` for ``0 <= j < count``.

    Four lags share what they load; up to three rows more than needed are read.
    """
    zero = constant(0.0)
    for j in range(0, count, 4):
        p0, p1, p2, p3 = zero, zero, zero, zero
        q0, q1, q2, q3 = zero, zero, zero, zero
        for i in range(0, size - 1, 2):
            v, w, k = load(table, x + i), load(table, x + i + 1), z + i - j
            z0, z1 = load(table, k), load(table, k - 1)
            z2, z3 = load(table, k - 2), load(table, k - 3)
            p0, p1, p2, p3 = fma(v, z0, p0), fma(v, z1, p1), fma(v, z2, p2), fma(v, z3, p3)
            q0, q1 = fma(w, load(table, k + 1), q0), fma(w, z0, q1)
            q2, q3 = fma(w, z1, q2), fma(w, z2, q3)
        if size % 2:
            v, k = load(table, x + size - 1), z + size - 1 - j
            p0, p1 = fma(v, load(table, k), p0), fma(v, load(table, k - 1), p1)
            p2, p3 = fma(v, load(table, k - 2), p2), fma(v, load(table, k - 3), p3)
        first = row + j * stride
        store(sums, first, add(load(sums, first), add(p0, q0)))
        if j + 1 < count:
            store(sums, first + stride, add(load(sums, first + stride), add(p1, q1)))
        if j + 2 < count:
            store(sums, first + 2 * stride, add(load(sums, first + 2 * stride), add(p2, q2)))
        if j + 3 < count:
            store(sums, first + 3 * stride, add(load(sums, first + 3 * stride), add(p3, q3)))


@njit
def _keep_ends(workspace, segment, history, at, ends):
    """The filtered signals at ``at - lag`` for all lags, as rows ``signal * history + lag``."""
    for signal in range(4):
        for lag in range(1, history):
            row = signal * segment + history + at - lag
            store(ends, signal * history + lag, load(workspace.filtered, row))


@njit
def forget_decayed(table, row, size):
    """Zero the lanes of a stretch that died out: denormal numbers are a hundred times slower."""
    for lane in range(LANES):
        largest = 0.0
        for i in range(row, row + size):
            largest = max(largest, abs(table[i, lane]))
        if largest < DECAYED:
            for i in range(row, row + size):
                table[i, lane] = 0.0


@inlined
def _gauss_newton(record, workspace, lag_sums):
    """Upper triangle of ``sum_t J_t J_t'`` over the samples that count, for the loaded models.

    ``J = [y_F(t-i), u_F(t-nk-j), e_F(t-k), i_F(t-k)]``, the derivatives with respect to the signed
    ``[a, b, c, d]``, of signals filtered through 1/C (Ljung 1999, section 10.3), ``i`` an impulse
    at ``residual_start``.  Only the first row and column of a block of lags are summed over the
    record; the others follow from their upper-left neighbours by exchanging the samples at its
    ends.
    ``lag_sums.sums`` is (n n, LANES), n the rows of a table of parameters.
    """
    heads, tails, sums = lag_sums
    c = record.na + record.nb
    width = c + 2 * record.rows_c
    counts = (record.na, record.nb, record.rows_c, record.rows_c)
    lags = (1, record.nk, 1, 0)
    places = (0, record.na, c, c + record.rows_c)
    # A bare 1 would be a type of its own, which the products would be compiled for once more.
    next_row = np.intp(1)
    history = heads.shape[0] // 4
    segment = history + CHUNK
    table = workspace.filtered
    fill(table, 0, table.shape[0], 0.0)
    fill(sums, 0, sums.shape[0], 0.0)
    for part in range(kept_residuals(record, workspace)[1]):
        first, stop = residuals_of_part(record, workspace, part)
        for begin in range(first, stop, CHUNK):
            end = min(begin + CHUNK, stop)
            _filter_signals(record, workspace, first - record.rows_c, begin, end, segment, history)
            if begin <= record.loss_start < end:
                _keep_ends(workspace, segment, history, record.loss_start - begin, heads)
            if begin < record.loss_stop <= end:
                _keep_ends(workspace, segment, history, record.loss_stop - begin, tails)
            low, high = max(begin, record.loss_start), min(end, record.loss_stop)
            size, now = high - low, history + low - begin
            for one in range(4):
                x = one * segment + now - lags[one]
                for other in range(one, 4):
                    z = other * segment + now - lags[other]
                    row = places[one] * width + places[other]
                    if size > 0 and counts[one] > 0:
                        _add_products(table, x, z, size, counts[other], sums, row, next_row)
                        if other > one and counts[other] > 0:
                            rest = counts[one] - 1
                            _add_products(table, z, x - 1, size, rest, sums, row + width, width)
            for signal in range(4):
                for row in range(signal * segment, signal * segment + history):
                    store(table, row, load(table, row + end - begin))
            forget_decayed(table, 3 * segment, history)
    minus = constant(-1.0)
    for one in range(4):
        for other in range(one, 4):
            for i in range(1, counts[one]):
                for j in range(i if one == other else 1, counts[other]):
                    row = (places[one] + i) * width + places[other] + j
                    x, z = one * history + lags[one] + i, other * history + lags[other] + j
                    g = fma(load(heads, x), load(heads, z), load(sums, row - width - 1))
                    tail = fma(load(tails, x), minus, constant(0.0))
                    store(sums, row, fma(tail, load(tails, z), g))


@cached_njit
def gauss_newton_matrices(
    record, objective, workspace, lag_sums, bandwidth, points, smoothing, barriers
):
    """Gauss-Newton part of the Hessian of each row's objective, (M, n, n); rows must be feasible.

    For the absolute value with the mean second derivative of :func:`_mean_second_derivatives`,
    whose width is ``bandwidth`` in mean ``|e|``.  The barrier of A and C, times ``barriers``, is
    added.
    """
    count, n = points.shape
    matrices = np.empty((count, n, n))
    width = workspace.parameters.shape[0]
    state = record.na + record.nb + record.nc
    order = max(record.na, record.nc)
    work, curvature = np.empty((order + 1, order)), np.empty((order, order))
    slopes, next_slopes = np.empty((order, order)), np.empty((order, order))
    for begin in range(0, count, LANES):
        rows = np.empty(min(LANES, count - begin), dtype=np.intp)
        for lane in range(rows.size):
            rows[lane] = begin + lane
        load_points(record, points, rows, workspace.parameters)
        if objective.absolute:
            load_smoothing(smoothing, rows, workspace)
            _mean_second_derivatives(record, workspace, bandwidth)
        else:
            store(workspace.total, 0, constant(2.0))
        _gauss_newton(record, workspace, lag_sums)
        for i in range(n):
            row = i if i < state else i - record.nc + record.rows_c
            own = -1.0 if record.na <= i < state else 1.0
            for j in range(i, n):
                column = j if j < state else j - record.nc + record.rows_c
                other = -1.0 if record.na <= j < state else 1.0
                for lane, r in enumerate(rows):
                    weight = objective.factor * own * other * workspace.total[0, lane]
                    matrices[r, i, j] = weight * lag_sums.sums[row * width + column, lane]
                    matrices[r, j, i] = matrices[r, i, j]
        for r in rows:
            for i in range(state, n):
                matrices[r, i, i] += 2.0 * objective.state_weight
            for low, high in ((0, record.na), (record.na + record.nb, state)):
                x = points[r, low:high]
                radius = objective.max_root_radius
                barrier_curvature(x, radius, work, slopes, next_slopes, curvature)
                for i in range(high - low):
                    for j in range(high - low):
                        matrices[r, low + i, low + j] += barriers[r] * curvature[i, j]
    return matrices
