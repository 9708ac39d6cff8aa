"""Jacobian of the residuals of the general polynomial model, and Gauss-Newton matrices.

By the signed parameters, with ``i`` an impulse at the first residual and ``1`` a constant, the
columns are delayed copies of ``(D/C) y``, ``(D/CF) u``, ``(1/C) e``, ``(1/C) v``, ``(D/CF) x``,
``(D/C) 1``, ``(D/CF) i`` and ``(1/C) i``.  A copy that is delayed by one sample more differs by the
sample before the record that enters it, times the response to an impulse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.cache import cached_njit, njit
from evopem.estimation.pem.kernels.gauss_newton import forget_decayed
from evopem.estimation.pem.kernels.polynomial_record import (
    ANY_OBJECTIVE,
    PolynomialObjective,
    PolynomialRecord,
    PolynomialWorkspace,
    load_polynomials,
    point_index,
)
from evopem.estimation.pem.kernels.polynomial_residuals import all_polynomial_residuals
from evopem.estimation.pem.kernels.record import BLOCK, CHUNK, fill, load_smoothing
from evopem.estimation.pem.kernels.residuals import filter_block, sum_of_losses
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

Array = NDArray[np.float64]

# Signals in the order in which they are filtered.
_Y, _U, _X, _V, _E, _IMPULSE, _ONE = range(7)


@njit
def _filter_inverse(parameters, at, rows, source, source_row, filtered, row, size):
    """Filter ``size`` rows through an inverse polynomial; copy them where it has no rows."""
    for i in range(0, size, BLOCK):
        q, p = source_row + i, row + i
        s0, s1 = load(source, q), load(source, q + 1)
        s2, s3 = load(source, q + 2), load(source, q + 3)
        if rows > 0:
            filter_block(parameters, at, rows, s0, s1, s2, s3, filtered, p)
        else:
            store(filtered, p, s0)
            store(filtered, p + 1, s1)
            store(filtered, p + 2, s2)
            store(filtered, p + 3, s3)


@njit
def _times_d(parameters, at, nd, source, filtered, row, size):
    """Filter ``size`` rows through D."""
    for i in range(size):
        s = load(source, row + i)
        for k in range(nd):
            s = fma(load(parameters, at + k), load(source, row + i - 1 - k), s)
        store(filtered, row + i, s)


@njit
def _fill_source(record, workspace, signal, begin, end):
    """A stretch of a signal, as the shortest delay of its parameters sees it."""
    source, before = workspace.source, record.residual_start - record.history
    for t in range(begin, end):
        if signal == _Y:
            s = sample(record.y, t - 1)
        elif signal == _U:
            s = sample(record.u, t - record.nk)
        elif signal == _X:
            s = load(workspace.x, t - 1 - before)
        elif signal == _V:
            s = load(workspace.v, t - 1 - before)
        elif signal == _E:
            s = load(workspace.e, t - 1 - before)
        elif signal == _IMPULSE:
            s = constant(1.0 if t == record.residual_start else 0.0)
        else:
            s = constant(1.0)
        store(source, t - begin, s)


@njit
def _delayed_columns(columns, first, count, stride, size, signal, past, impulse, impulse_row):
    """Columns ``first + 1 ... first + count - 1`` from the one before them, a sample later each.

    ``signal[past - j]`` enters the j-th copy at the first residual.
    """
    for j in range(1, count):
        one, other = (first + j - 1) * stride, (first + j) * stride
        entering = sample(signal, past - j)
        for i in range(size):
            s = fma(entering, load(impulse, impulse_row + i), load(columns, one + i))
            store(columns, other + 1 + i, s)


@njit
def _shifted_columns(columns, first, count, stride, size):
    """Columns ``first + 1 ... first + count - 1`` from the one before them, a sample later each."""
    for j in range(1, count):
        one, other = (first + j - 1) * stride, (first + j) * stride
        for i in range(size):
            store(columns, other + 1 + i, load(columns, one + i))


@njit
def _copy_rows(source, source_row, columns, column, stride, size):
    for i in range(size):
        store(columns, column * stride + 1 + i, load(source, source_row + i))


@njit
def _jacobian_stretch(record, workspace, begin, end):
    """Rows ``begin <= t < end`` of the Jacobian, signed parameter by signed parameter.

    Row ``1 + t - begin`` of the ``CHUNK + 1`` rows of a column is sample t; row 0 is the sample
    before.
    """
    parameters, columns = workspace.parameters, workspace.columns
    by_c, by_d, by_f = workspace.by_c, workspace.by_d, workspace.by_f
    history, size, stride = record.history, end - begin, CHUNK + 1
    segment = history + CHUNK
    for signal in range(7):
        through_c_alone = signal in (_V, _E)
        if signal == _Y and record.na == 0:
            continue
        if signal == _U and record.nb == 0:
            continue
        if signal == _X and record.nf == 0:
            continue
        if signal == _V and record.nd == 0:
            continue
        if signal == _E and record.nc == 0:
            continue
        if signal == _ONE and record.level == 0:
            continue
        row = signal * segment + history
        _fill_source(record, workspace, signal, begin, end)
        _filter_inverse(
            parameters, record.at_c, record.rows_c, workspace.source, 0, by_c, row, size
        )
        if not through_c_alone:
            _times_d(parameters, record.at_d, record.nd, by_c, by_d, row, size)
        if signal in (_U, _X, _IMPULSE):
            _filter_inverse(parameters, record.at_f, record.rows_f, by_d, row, by_f, row, size)
    impulse = _IMPULSE * segment + history
    if record.na > 0:
        _copy_rows(by_d, _Y * segment + history, columns, 0, stride, size)
        past = record.residual_start - 1
        _delayed_columns(columns, 0, record.na, stride, size, record.y, past, by_d, impulse)
    if record.nb > 0:
        first, past = record.na, record.residual_start - record.nk
        _copy_rows(by_f, _U * segment + history, columns, first, stride, size)
        _delayed_columns(columns, first, record.nb, stride, size, record.u, past, by_f, impulse)
    if record.nc > 0:
        _copy_rows(by_c, _E * segment + history, columns, record.at_c, stride, size)
        _shifted_columns(columns, record.at_c, record.nc, stride, size)
    if record.nd > 0:
        _copy_rows(by_c, _V * segment + history, columns, record.at_d, stride, size)
        _shifted_columns(columns, record.at_d, record.nd, stride, size)
    if record.nf > 0:
        _copy_rows(by_f, _X * segment + history, columns, record.at_f, stride, size)
        _shifted_columns(columns, record.at_f, record.nf, stride, size)
        _copy_rows(by_f, impulse, columns, record.at_g, stride, size)
        _shifted_columns(columns, record.at_g, record.nf, stride, size)
    if record.level:
        _copy_rows(by_d, _ONE * segment + history, columns, record.at_level, stride, size)
    if record.states > 0:
        _copy_rows(by_c, impulse, columns, record.at_s, stride, size)
        _shifted_columns(columns, record.at_s, record.states, stride, size)


@njit
def _keep_last(record, workspace, size):
    """What the next stretch looks back on."""
    segment = record.history + CHUNK
    for signal in range(7):
        for row in range(signal * segment, signal * segment + record.history):
            store(workspace.by_c, row, load(workspace.by_c, row + size))
            store(workspace.by_d, row, load(workspace.by_d, row + size))
            store(workspace.by_f, row, load(workspace.by_f, row + size))
    impulse = _IMPULSE * segment
    forget_decayed(workspace.by_c, impulse, record.history)
    forget_decayed(workspace.by_d, impulse, record.history)
    forget_decayed(workspace.by_f, impulse, record.history)
    for column in range(record.rows):
        row = column * (CHUNK + 1)
        store(workspace.columns, row, load(workspace.columns, row + size))


@njit
def _forget(workspace):
    for table in (workspace.by_c, workspace.by_d, workspace.by_f, workspace.columns):
        fill(table, 0, table.shape[0], 0.0)


@njit
def _add_products(record, workspace, low, size):
    """Add the products of columns, of ``size`` rows from row ``low`` of each on."""
    columns, products = workspace.columns, workspace.products
    zero, stride, width = constant(0.0), CHUNK + 1, record.rows
    for one in range(width):
        x = one * stride + low
        for other in range(one, width, 4):
            s0, s1, s2, s3 = zero, zero, zero, zero
            z = other * stride + low
            for i in range(size):
                p = load(columns, x + i)
                s0, s1 = fma(p, load(columns, z + i), s0), fma(p, load(columns, z + stride + i), s1)
                s2 = fma(p, load(columns, z + 2 * stride + i), s2)
                s3 = fma(p, load(columns, z + 3 * stride + i), s3)
            row = one * (width + 4) + other
            store(products, row, add(load(products, row), s0))
            store(products, row + 1, add(load(products, row + 1), s1))
            store(products, row + 2, add(load(products, row + 2), s2))
            store(products, row + 3, add(load(products, row + 3), s3))


@njit
def _pass_of_columns(record, workspace, jacobian):
    """``sum_t J_t J_t'`` over the samples that count, or where it has rows the first model's J."""
    fill(workspace.products, 0, workspace.products.shape[0], 0.0)
    _forget(workspace)
    for begin in range(record.residual_start, record.y.size, CHUNK):
        end = min(begin + CHUNK, record.y.size)
        _jacobian_stretch(record, workspace, begin, end)
        low, high = max(begin, record.loss_start), min(end, record.loss_stop)
        if high > low and jacobian.shape[0] > 0:
            _copy_columns(record, workspace.columns, begin, low, high, jacobian)
        elif high > low:
            _add_products(record, workspace, 1 + low - begin, high - low)
        _keep_last(record, workspace, end - begin)


@njit
def _copy_columns(record, columns, begin, low, high, jacobian):
    """Samples ``low <= t < high`` of a stretch's columns, by the entries of a point."""
    for row in range(record.rows):
        index, sign = point_index(record, row)
        if index >= 0:
            for t in range(low, high):
                value = columns[row * (CHUNK + 1) + 1 + t - begin, 0]
                jacobian[t - record.loss_start, index] = sign * value


@njit
def _mean_second_derivatives(record, workspace, bandwidth):
    """Mean second derivative of ``sqrt(e**2 + width**2)`` over the residuals, to ``total``.

    Twice a kernel estimate of their density at zero, ``width`` being ``bandwidth`` in mean ``|e|``
    but no narrower than the smoothing.
    """
    zero, before = constant(0.0), record.residual_start - record.history
    first, last = record.loss_start - before, record.loss_stop - before
    count = last - first
    store(workspace.total, 0, sum_of_losses(workspace.e, True, first, last, zero))
    for lane in range(LANES):
        width = bandwidth * workspace.total[0, lane] / count
        workspace.total[0, lane] = max(width, workspace.smoothing[0, lane])
    width_squared = fma(load(workspace.total, 0), load(workspace.total, 0), zero)
    s = zero
    for row in range(first, last):
        value = load(workspace.e, row)
        r = fma(value, value, width_squared)
        s = add(s, divide(width_squared, fma(r, square_root(r), zero)))
    store(workspace.total, 0, s)
    for lane in range(LANES):
        workspace.total[0, lane] /= count


@cached_njit
def _pass(record, objective, workspace, bandwidth, points, smoothing, barriers, jacobian):
    """Gauss-Newton matrices, or where ``jacobian`` has rows that of the first point instead.

    One function for both, compiled and loaded once.
    """
    count, n = points.shape
    matrices = np.zeros((count, n, n))
    c = record.na + record.nb
    d = c + record.nc
    f = d + record.nd
    at_s = n - record.states
    parts = ((0, record.na), (c, d), (d, f), (f, f + record.nf))
    radii = (
        objective.plant_radius,
        objective.noise_radius,
        objective.noise_radius,
        objective.plant_radius,
    )
    order = max(record.na, record.nc, record.nd, record.nf)
    work, curvature = np.empty((order + 1, order)), np.empty((order, order))
    slopes, next_slopes = np.empty((order, order)), np.empty((order, order))
    for begin in range(0, count, LANES):
        rows = np.arange(begin, min(begin + LANES, count))
        load_polynomials(record, points, rows, workspace.parameters)
        all_polynomial_residuals(record, workspace)
        _pass_of_columns(record, workspace, jacobian)
        if jacobian.shape[0] > 0:
            break
        if objective.absolute:
            load_smoothing(smoothing, rows, workspace)
            _mean_second_derivatives(record, workspace, bandwidth)
        else:
            store(workspace.total, 0, constant(2.0))
        for row in range(record.rows):
            i, own = point_index(record, row)
            for column in range(row, record.rows):
                j, other = point_index(record, column)
                if i >= 0 and j >= 0:
                    for lane, r in enumerate(rows):
                        weight = objective.factor * own * other * workspace.total[0, lane]
                        product = workspace.products[row * (record.rows + 4) + column, lane]
                        matrices[r, i, j] = weight * product
                        matrices[r, j, i] = matrices[r, i, j]
        for r in rows:
            for i in range(at_s - record.nf, at_s):
                matrices[r, i, i] += 2.0 * objective.plant_state_weight
            for i in range(at_s, n):
                matrices[r, i, i] += 2.0 * objective.noise_state_weight
            for part in range(4):
                low, high = parts[part]
                x = points[r, low:high]
                barrier_curvature(x, radii[part], work, slopes, next_slopes, curvature)
                for i in range(high - low):
                    for j in range(high - low):
                        matrices[r, low + i, low + j] += barriers[r] * curvature[i, j]
    return matrices


def polynomial_jacobian(
    record: PolynomialRecord, workspace: PolynomialWorkspace, points: Array, rows: NDArray[np.intp]
) -> Array:
    """Derivatives of the residuals that count by every entry of one point, (samples, n)."""
    jacobian = np.empty((record.loss_stop - record.loss_start, points.shape[1]))
    point, none = np.ascontiguousarray(points[rows]), np.zeros(1)
    _pass(record, ANY_OBJECTIVE, workspace, 0.0, point, none, none, jacobian)
    return jacobian


def polynomial_gauss_newton_matrices(
    record: PolynomialRecord,
    objective: PolynomialObjective,
    workspace: PolynomialWorkspace,
    bandwidth: float,
    points: Array,
    smoothing: Array,
    barriers: Array,
) -> Array:
    """Gauss-Newton part of the Hessian of each row's objective, (M, n, n); rows must be feasible.

    For the absolute value with the mean second derivative of :func:`_mean_second_derivatives`,
    whose width is ``bandwidth`` in mean ``|e|``.  The barriers of A, C, D and F, times
    ``barriers``, are added.
    """
    none = np.empty((0, points.shape[1]))
    matrices: Array = _pass(
        record, objective, workspace, bandwidth, points, smoothing, barriers, none
    )
    return matrices
