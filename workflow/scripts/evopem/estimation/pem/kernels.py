"""Compiled kernels of ARMAX models: residuals, loss, adjoint gradient, Gauss-Newton, stability.

Eight candidate models share one pass over the record, one in each lane of a SIMD vector, so that
the sequential recursion through 1/C costs the same for eight models as for one.  All arithmetic
is IEEE and explicitly ordered (no reassociation; fused multiply-adds where the code says so), so
the bits of a result do not depend on the width of a machine's vectors or on which models share a
pass.

The recursion works through blocks of four samples; callers pad the record accordingly (see
:func:`padded_length`).  Parameters arrive *signed*: rows ``[a, -b, -c, d]``, with C padded by zero
coefficients to :data:`MIN_NC` rows, so that every term of the recursion is an addition.  ``d``,
as many rows as C has, is the state that the unknown noise before the record left behind: ``d_i``
is added to the equation error of sample ``start + i``.

Everything compiled lives in this one file because numba's on-disk cache notices changes of the
file that defines a function, and of no other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.extending import intrinsic, register_model
from numpy.typing import NDArray

LANES = 8
BLOCK = 4
MIN_NC = BLOCK - 1
# Samples of a stretch, a multiple of two blocks: what is kept of it fits the nearest cache.
CHUNK = 128
# Magnitude below which an impulse response has died out.
DECAYED = 1e-100

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class _LanesType(types.Type):
    """The numba type of one SIMD vector of eight doubles."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


_lanes = _LanesType()


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type) -> None:  # type: ignore[no-untyped-def]
        super().__init__(dmm, fe_type, _VECTOR)


def _splat(builder, scalar):  # type: ignore[no-untyped-def]
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, zeros)


def _row_pointer(context, builder, array_type, array, row):  # type: ignore[no-untyped-def]
    data = context.make_array(array_type)(context, builder, array).data
    offset = builder.mul(row, ir.Constant(row.type, LANES))
    return builder.bitcast(builder.gep(data, [offset]), _VECTOR.as_pointer())


@intrinsic
def _constant(typingctx, scalar):  # type: ignore[no-untyped-def]
    """All lanes equal to a scalar."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _splat(builder, args[0])

    return _lanes(types.float64), codegen


@intrinsic
def _sample(typingctx, signal, index):  # type: ignore[no-untyped-def]
    """All lanes equal to ``signal[index]``; the index is trusted (no wrap-around test)."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return _splat(builder, builder.load(builder.gep(data, [args[1]])))

    return _lanes(signal, types.intp), codegen


@intrinsic
def _load(typingctx, table, row):  # type: ignore[no-untyped-def]
    """Row of a C-contiguous (rows, LANES) table as one vector."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        pointer = _row_pointer(context, builder, signature.args[0], args[0], args[1])
        return builder.load(pointer, align=8)

    return _lanes(table, types.intp), codegen


@intrinsic
def _store(typingctx, table, row, lanes):  # type: ignore[no-untyped-def]
    """Write one vector to a row of a C-contiguous (rows, LANES) table."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        pointer = _row_pointer(context, builder, signature.args[0], args[0], args[1])
        builder.store(args[2], pointer, align=8)
        return context.get_dummy_value()

    return types.void(table, types.intp, _lanes), codegen


def _call(builder, name, arguments):  # type: ignore[no-untyped-def]
    function_type = ir.FunctionType(_VECTOR, [_VECTOR] * len(arguments))
    function = cgutils.get_or_insert_function(
        builder.module, function_type, f"llvm.{name}.v{LANES}f64"
    )
    return builder.call(function, arguments)


@intrinsic
def _fma(typingctx, x, y, z):  # type: ignore[no-untyped-def]
    """``x * y + z`` rounded once."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _call(builder, "fma", args)

    return _lanes(_lanes, _lanes, _lanes), codegen


@intrinsic
def _sqrt(typingctx, x):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _call(builder, "sqrt", args)

    return _lanes(_lanes), codegen


@intrinsic
def _abs(typingctx, x):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _call(builder, "fabs", args)

    return _lanes(_lanes), codegen


@intrinsic
def _add(typingctx, x, y):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.fadd(*args)

    return _lanes(_lanes, _lanes), codegen


@intrinsic
def _divide(typingctx, x, y):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.fdiv(*args)

    return _lanes(_lanes, _lanes), codegen


def padded_length(samples: int, start: int) -> int:
    """Length to which records are padded so that ``start ... end`` is whole pairs of blocks."""
    return start + 2 * BLOCK * -(-(samples - start) // (2 * BLOCK))


def lanes_table(rows: int) -> NDArray[np.float64]:
    """A (rows, LANES) table of zeros whose rows do not straddle the lines of a cache."""
    line = 8 * LANES
    raw = np.zeros(LANES * (rows + 1))
    skipped = -raw.ctypes.data % line // raw.itemsize
    table: NDArray[np.float64] = raw[skipped : skipped + LANES * rows].reshape(rows, LANES)
    return table


class Record(NamedTuple):
    """A record, the orders of the models that share a pass over it, and what counts.

    ``y`` and ``u`` are padded to :func:`padded_length`.  ``rows_c`` is nc, or :data:`MIN_NC` where
    that is more.  Residuals begin at ``start`` (at least ``max(na, nb + nk - 1, MIN_NC)``) and
    count where ``first <= t < last``.
    """

    y: NDArray[np.float64]
    u: NDArray[np.float64]
    na: int
    nb: int
    nc: int
    nk: int
    rows_c: int
    start: int
    first: int
    last: int


class Objective(NamedTuple):
    """What a sum of losses is worth, and which points have one.

    ``absolute`` or else square loss, times ``factor``; ``state_weight`` times the square of the
    noise state is added.  Roots of A and C beyond ``max_root_radius`` are infeasible.
    """

    absolute: bool
    factor: float
    state_weight: float
    max_root_radius: float


class Tables(NamedTuple):
    """Buffers of a pass.

    Parameters and gradient of the loaded models, their residuals, one row each for the corners of
    the absolute value and for sums, a stretch of residuals or slopes, and stretches of signals
    filtered through 1/C.
    """

    parameters: NDArray[np.float64]
    gradient: NDArray[np.float64]
    residuals: NDArray[np.float64]
    corner: NDArray[np.float64]
    total: NDArray[np.float64]
    window: NDArray[np.float64]
    filtered: NDArray[np.float64]


class LagSums(NamedTuple):
    """Buffers of the products of lags: signals at the record's two ends, and the sums."""

    heads: NDArray[np.float64]
    tails: NDArray[np.float64]
    sums: NDArray[np.float64]


def tables_for(record: Record) -> Tables:
    """Buffers for passes over a record."""
    rows = record.na + record.nb + 2 * record.rows_c
    return Tables(
        parameters=lanes_table(rows),
        gradient=lanes_table(rows),
        residuals=lanes_table(len(record.y)),
        corner=lanes_table(1),
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


@njit(error_model="numpy", cache=True)
def _load_points(record, points, rows, parameters):  # type: ignore[no-untyped-def]
    """Signed parameters of up to eight rows of a population, one in each lane, others zero."""
    noise = record.na + record.nb
    parameters[:] = 0.0
    for lane, r in enumerate(rows):
        for i in range(record.na):
            parameters[i, lane] = points[r, i]
        for i in range(record.na, noise + record.nc):
            parameters[i, lane] = -points[r, i]
        for k in range(record.nc):
            parameters[noise + record.rows_c + k, lane] = points[r, noise + record.nc + k]


@njit(error_model="numpy", cache=True)
def _filter_block(parameters, c, nc, s0, s1, s2, s3, filtered, row):  # type: ignore[no-untyped-def]
    """Filter four samples through 1/C into rows ``row ... row + 3``; the nc before are known."""
    for k in range(nc - 1, MIN_NC - 1, -1):
        p, q = _load(parameters, c + k), row - 1 - k
        s0, s1 = _fma(p, _load(filtered, q), s0), _fma(p, _load(filtered, q + 1), s1)
        s2, s3 = _fma(p, _load(filtered, q + 2), s2), _fma(p, _load(filtered, q + 3), s3)
    c1, c2, c3 = _load(parameters, c), _load(parameters, c + 1), _load(parameters, c + 2)
    e1, e2, e3 = _load(filtered, row - 1), _load(filtered, row - 2), _load(filtered, row - 3)
    s0 = _fma(c1, e1, _fma(c2, e2, _fma(c3, e3, s0)))
    s1 = _fma(c1, s0, _fma(c2, e1, _fma(c3, e2, s1)))
    s2 = _fma(c1, s1, _fma(c2, s0, _fma(c3, e1, s2)))
    s3 = _fma(c1, s2, _fma(c2, s1, _fma(c3, s0, s3)))
    _store(filtered, row, s0)
    _store(filtered, row + 1, s1)
    _store(filtered, row + 2, s2)
    _store(filtered, row + 3, s3)


@njit(error_model="numpy", cache=True)
def _load_corners(corners, rows, tables):  # type: ignore[no-untyped-def]
    """The corners of the loaded models' absolute values, 1 in the lanes left over."""
    tables.corner[:] = 1.0
    for lane, r in enumerate(rows):
        tables.corner[0, lane] = corners[r]


@njit(error_model="numpy", cache=True)
def _residuals(record, parameters, e, before, begin, end):  # type: ignore[no-untyped-def]
    """Residuals ``C e = A y - B u + d`` of eight models at ``begin <= t < end``, whole blocks.

    Row ``t - before`` of ``e`` is sample t; the ``rows_c`` rows before the first are known.
    """
    y, u, na, nb, nc, start = record.y, record.u, record.na, record.nb, record.rows_c, record.start
    c = na + nb
    for t in range(begin, end, BLOCK):
        s0, s1, s2, s3 = _sample(y, t), _sample(y, t + 1), _sample(y, t + 2), _sample(y, t + 3)
        if t < start + nc:
            row, last = c + nc + t - start, c + 2 * nc - 1
            s0 = _add(s0, _load(parameters, row))
            if row + 1 <= last:
                s1 = _add(s1, _load(parameters, row + 1))
            if row + 2 <= last:
                s2 = _add(s2, _load(parameters, row + 2))
            if row + 3 <= last:
                s3 = _add(s3, _load(parameters, row + 3))
        for i in range(na):
            p, q = _load(parameters, i), t - 1 - i
            s0, s1 = _fma(p, _sample(y, q), s0), _fma(p, _sample(y, q + 1), s1)
            s2, s3 = _fma(p, _sample(y, q + 2), s2), _fma(p, _sample(y, q + 3), s3)
        for j in range(nb):
            p, q = _load(parameters, na + j), t - record.nk - j
            s0, s1 = _fma(p, _sample(u, q), s0), _fma(p, _sample(u, q + 1), s1)
            s2, s3 = _fma(p, _sample(u, q + 2), s2), _fma(p, _sample(u, q + 3), s3)
        row = t - before
        _filter_block(parameters, c, nc, s0, s1, s2, s3, e, row)


@njit(error_model="numpy", cache=True)
def _all_residuals(record, tables):  # type: ignore[no-untyped-def]
    """Residuals of the loaded models, zero before ``start`` and meaningless beyond the record."""
    tables.residuals[: record.start] = 0.0
    _residuals(record, tables.parameters, tables.residuals, 0, record.start, record.y.size)


@njit(error_model="numpy", cache=True)
def _loss(e, absolute, begin, end, s):  # type: ignore[no-untyped-def]
    """``s`` plus the sum of ``|e|`` or ``e**2`` over rows of a table, lane by lane."""
    if absolute:
        for row in range(begin, end):
            s = _add(s, _abs(_load(e, row)))
    else:
        for row in range(begin, end):
            v = _load(e, row)
            s = _fma(v, v, s)
    return s


@njit(error_model="numpy", cache=True)
def residuals(record, tables, point):  # type: ignore[no-untyped-def]
    """Residuals of one point, (T,), zero before ``start``."""
    _load_points(record, point.reshape(1, point.size), np.zeros(1, np.intp), tables.parameters)
    _all_residuals(record, tables)
    return tables.residuals[:, 0].copy()


@njit(error_model="numpy", cache=True)
def _square_of_state(record, point):  # type: ignore[no-untyped-def]
    square = 0.0
    for k in range(record.na + record.nb + record.nc, point.size):
        square += point[k] * point[k]
    return square


@njit(error_model="numpy", cache=True)
def values(record, objective, tables, points):  # type: ignore[no-untyped-def]
    """Objective of each row of a population, (M,); infeasible rows are inf.

    Only as much of the residuals is kept as the recursion looks back on.
    """
    found = np.full(points.shape[0], np.inf)
    feasible = np.flatnonzero(feasible_rows(record, objective.max_root_radius, points))
    history = record.rows_c
    for i in range(0, feasible.size, LANES):
        rows = feasible[i : i + LANES]
        _load_points(record, points, rows, tables.parameters)
        tables.window[:history] = 0.0
        s = _constant(0.0)
        for begin in range(record.start, record.y.size, CHUNK):
            end = min(begin + CHUNK, record.y.size)
            before = begin - history
            _residuals(record, tables.parameters, tables.window, before, begin, end)
            first, last = max(begin, record.first) - before, min(end, record.last) - before
            s = _loss(tables.window, objective.absolute, first, last, s)
            for k in range(history):
                _store(tables.window, k, _load(tables.window, end - begin + k))
        _store(tables.total, 0, s)
        for lane, r in enumerate(rows):
            value = objective.factor * tables.total[0, lane]
            value += objective.state_weight * _square_of_state(record, points[r])
            if np.isfinite(value):
                found[r] = value
    return found


@njit(error_model="numpy", cache=True)
def _slopes(record, tables, absolute, slope, begin, end, s):  # type: ignore[no-untyped-def]
    """Derivative of the loss with respect to each residual, from row 0 on; ``s`` plus the losses.

    The absolute value has its corner rounded: ``sqrt(e**2 + corner**2)``.
    """
    zero, two = _constant(0.0), _constant(2.0)
    e = tables.residuals
    corner_squared = _fma(_load(tables.corner, 0), _load(tables.corner, 0), zero)
    for t in range(begin, end):
        if t < record.first or t >= record.last:
            _store(slope, t - begin, zero)
        elif absolute:
            v = _load(e, t)
            r = _sqrt(_fma(v, v, corner_squared))
            s = _add(s, r)
            _store(slope, t - begin, _divide(v, r))
        else:
            v = _load(e, t)
            s = _fma(v, v, s)
            _store(slope, t - begin, _fma(two, v, zero))
    return s


@njit(error_model="numpy", cache=True)
def _filter_block_back(parameters, c, nc, slope, row):  # type: ignore[no-untyped-def]
    """Filter rows ``row ... row - 3`` backwards through 1/C in place, and return them."""
    s0, s1 = _load(slope, row), _load(slope, row - 1)
    s2, s3 = _load(slope, row - 2), _load(slope, row - 3)
    for k in range(nc - 1, MIN_NC - 1, -1):
        p, q = _load(parameters, c + k), row + 1 + k
        s0, s1 = _fma(p, _load(slope, q), s0), _fma(p, _load(slope, q - 1), s1)
        s2, s3 = _fma(p, _load(slope, q - 2), s2), _fma(p, _load(slope, q - 3), s3)
    c1, c2, c3 = _load(parameters, c), _load(parameters, c + 1), _load(parameters, c + 2)
    n1, n2, n3 = _load(slope, row + 1), _load(slope, row + 2), _load(slope, row + 3)
    s0 = _fma(c1, n1, _fma(c2, n2, _fma(c3, n3, s0)))
    s1 = _fma(c1, s0, _fma(c2, n1, _fma(c3, n2, s1)))
    s2 = _fma(c1, s1, _fma(c2, s0, _fma(c3, n1, s2)))
    s3 = _fma(c1, s2, _fma(c2, s1, _fma(c3, s0, s3)))
    _store(slope, row, s0)
    _store(slope, row - 1, s1)
    _store(slope, row - 2, s2)
    _store(slope, row - 3, s3)
    return s0, s1, s2, s3


@njit(error_model="numpy", cache=True)
def _sweep_back(record, parameters, e, slope, begin, end, gradient):  # type: ignore[no-untyped-def]
    """Filter the slopes of a stretch backwards through 1/C, and correlate them with the signals.

    Row ``t - begin`` of ``slope`` is sample t; the ``rows_c`` rows after the last are known.  The
    correlations keep the processor busy while the recursion waits for itself.
    """
    y, u, na, nb, nc = record.y, record.u, record.na, record.nb, record.rows_c
    zero = _constant(0.0)
    c = na + nb
    for t in range(end - 1, begin, -2 * BLOCK):
        s0, s1, s2, s3 = _filter_block_back(parameters, c, nc, slope, t - begin)
        s4, s5, s6, s7 = _filter_block_back(parameters, c, nc, slope, t - begin - BLOCK)
        for i in range(na):
            q = t - 1 - i
            even = _fma(s2, _sample(y, q - 2), _fma(s0, _sample(y, q), _load(gradient, i)))
            odd = _fma(s3, _sample(y, q - 3), _fma(s1, _sample(y, q - 1), zero))
            even = _fma(s6, _sample(y, q - 6), _fma(s4, _sample(y, q - 4), even))
            odd = _fma(s7, _sample(y, q - 7), _fma(s5, _sample(y, q - 5), odd))
            _store(gradient, i, _add(even, odd))
        for j in range(nb):
            row, q = na + j, t - record.nk - j
            even = _fma(s2, _sample(u, q - 2), _fma(s0, _sample(u, q), _load(gradient, row)))
            odd = _fma(s3, _sample(u, q - 3), _fma(s1, _sample(u, q - 1), zero))
            even = _fma(s6, _sample(u, q - 6), _fma(s4, _sample(u, q - 4), even))
            odd = _fma(s7, _sample(u, q - 7), _fma(s5, _sample(u, q - 5), odd))
            _store(gradient, row, _add(even, odd))
        for k in range(nc):
            row, q = c + k, t - 1 - k
            even = _fma(s2, _load(e, q - 2), _fma(s0, _load(e, q), _load(gradient, row)))
            odd = _fma(s3, _load(e, q - 3), _fma(s1, _load(e, q - 1), zero))
            even = _fma(s6, _load(e, q - 6), _fma(s4, _load(e, q - 4), even))
            odd = _fma(s7, _load(e, q - 7), _fma(s5, _load(e, q - 5), odd))
            _store(gradient, row, _add(even, odd))


@njit(error_model="numpy", cache=True)
def _loss_and_gradient(record, tables, absolute):  # type: ignore[no-untyped-def]
    """Loss of the loaded models, and by one backward pass its gradient, whatever their size.

    The gradient, with respect to the signed parameters, goes to its table; the loss is returned.
    """
    _all_residuals(record, tables)
    tables.gradient[:] = 0.0
    slope, history = tables.window, record.rows_c
    slope[:] = 0.0
    s = _constant(0.0)
    end = record.y.size
    while True:
        begin = max(end - CHUNK, record.start)
        s = _slopes(record, tables, absolute, slope, begin, end, s)
        _sweep_back(record, tables.parameters, tables.residuals, slope, begin, end, tables.gradient)
        if begin == record.start:
            break
        following = min(CHUNK, begin - record.start)
        for k in range(history - 1, -1, -1):
            _store(slope, following + k, _load(slope, k))
        end = begin
    noise_state = record.na + record.nb + history
    for k in range(history):
        _store(tables.gradient, noise_state + k, _load(slope, k))
    return s


@njit(error_model="numpy", cache=True)
def values_and_gradients(  # type: ignore[no-untyped-def]
    record, objective, tables, points, corners, barriers
):
    """Smoothed objective of each row with a barrier added, and its gradient.

    The absolute value has its corner rounded: ``sqrt(e**2 + corner**2)``.  The barrier is that of
    :func:`stability_barriers`, of A and of C, times ``barriers``.  Infeasible rows are inf and 0.
    """
    found = np.full(points.shape[0], np.inf)
    gradients = np.zeros(points.shape)
    a, noise = record.na, record.na + record.nb
    c = noise + record.nc
    of_a, gradients[:, :a] = stability_barriers(points[:, :a], objective.max_root_radius)
    of_c, gradients[:, noise:c] = stability_barriers(points[:, noise:c], objective.max_root_radius)
    feasible = np.flatnonzero(np.isfinite(of_a + of_c))
    for i in range(0, feasible.size, LANES):
        rows = feasible[i : i + LANES]
        _load_points(record, points, rows, tables.parameters)
        _load_corners(corners, rows, tables)
        _store(tables.total, 0, _loss_and_gradient(record, tables, objective.absolute))
        for lane, r in enumerate(rows):
            gradients[r] *= barriers[r]
            _unload_gradient(record, objective, tables.gradient, lane, points[r], gradients[r])
            value = objective.factor * tables.total[0, lane] + barriers[r] * (of_a[r] + of_c[r])
            value += objective.state_weight * _square_of_state(record, points[r])
            if np.isfinite(value) and np.isfinite(gradients[r]).all():
                found[r] = value
    for r in range(found.size):
        if not np.isfinite(found[r]):
            gradients[r] = 0.0
    return found, gradients


@njit(error_model="numpy", cache=True)
def _unload_gradient(record, objective, table, lane, point, gradient):  # type: ignore[no-untyped-def]
    """Add one lane's gradient, with respect to the signed parameters, to a row of gradients."""
    factor, state = objective.factor, record.na + record.nb + record.nc
    for i in range(record.na):
        gradient[i] += factor * table[i, lane]
    for i in range(record.na, state):
        gradient[i] -= factor * table[i, lane]
    for k in range(record.nc):
        gradient[state + k] += factor * table[record.na + record.nb + record.rows_c + k, lane]
        gradient[state + k] += 2.0 * objective.state_weight * point[state + k]


@njit(error_model="numpy", cache=True)
def _mean_curvatures(record, tables, bandwidth):  # type: ignore[no-untyped-def]
    """Mean second derivative of ``sqrt(e**2 + width**2)`` over the scored residuals, to ``total``.

    Twice a kernel estimate of their density at zero, ``width`` being ``bandwidth`` in mean ``|e|``
    but no narrower than the corner.
    """
    zero = _constant(0.0)
    count = record.last - record.first
    s = _loss(tables.residuals, True, record.first, record.last, zero)
    _store(tables.total, 0, s)
    for lane in range(LANES):
        width = bandwidth * tables.total[0, lane] / count
        tables.total[0, lane] = max(width, tables.corner[0, lane])
    width_squared = _fma(_load(tables.total, 0), _load(tables.total, 0), zero)
    s = zero
    for t in range(record.first, record.last):
        v = _load(tables.residuals, t)
        r = _fma(v, v, width_squared)
        s = _add(s, _divide(width_squared, _fma(r, _sqrt(r), zero)))
    _store(tables.total, 0, s)
    for lane in range(LANES):
        tables.total[0, lane] /= count


@njit(error_model="numpy", cache=True)
def _inverse_filter(  # type: ignore[no-untyped-def]
    parameters, c, nc, source, source_row, size, filtered, filtered_row
):
    """Filter ``size`` rows of a table through 1/C; the nc rows before the first are known."""
    for i in range(0, size, BLOCK):
        row = source_row + i
        s0, s1 = _load(source, row), _load(source, row + 1)
        s2, s3 = _load(source, row + 2), _load(source, row + 3)
        _filter_block(parameters, c, nc, s0, s1, s2, s3, filtered, filtered_row + i)


@njit(error_model="numpy", cache=True)
def _filter_signals(record, tables, begin, end, segment, history):  # type: ignore[no-untyped-def]
    """A stretch of ``y``, ``u``, ``e`` and an impulse at ``start``, filtered through 1/C."""
    table, source, size = tables.filtered, 4 * segment, end - begin
    c, nc = record.na + record.nb, record.rows_c
    parameters = tables.parameters
    for t in range(begin, end):
        _store(table, source + t - begin, _sample(record.y, t))
    _inverse_filter(parameters, c, nc, table, source, size, table, history)
    for t in range(begin, end):
        _store(table, source + t - begin, _sample(record.u, t))
    _inverse_filter(parameters, c, nc, table, source, size, table, segment + history)
    _inverse_filter(parameters, c, nc, tables.residuals, begin, size, table, 2 * segment + history)
    for t in range(begin, end):
        _store(table, source + t - begin, _constant(1.0 if t == record.start else 0.0))
    _inverse_filter(parameters, c, nc, table, source, size, table, 3 * segment + history)


@njit(error_model="numpy", cache=True)
def _add_products(table, x, z, size, count, sums, row, stride):  # type: ignore[no-untyped-def]
    """``sums[row + j stride] += sum_i table[x + i] table[z + i - j]`` for ``0 <= j < count``.

    Four lags share what they load; up to three rows more than needed are read.
    """
    zero = _constant(0.0)
    for j in range(0, count, 4):
        p0, p1, p2, p3 = zero, zero, zero, zero
        q0, q1, q2, q3 = zero, zero, zero, zero
        for i in range(0, size - 1, 2):
            v, w, k = _load(table, x + i), _load(table, x + i + 1), z + i - j
            z0, z1 = _load(table, k), _load(table, k - 1)
            z2, z3 = _load(table, k - 2), _load(table, k - 3)
            p0, p1, p2, p3 = _fma(v, z0, p0), _fma(v, z1, p1), _fma(v, z2, p2), _fma(v, z3, p3)
            q0, q1 = _fma(w, _load(table, k + 1), q0), _fma(w, z0, q1)
            q2, q3 = _fma(w, z1, q2), _fma(w, z2, q3)
        if size % 2:
            v, k = _load(table, x + size - 1), z + size - 1 - j
            p0, p1 = _fma(v, _load(table, k), p0), _fma(v, _load(table, k - 1), p1)
            p2, p3 = _fma(v, _load(table, k - 2), p2), _fma(v, _load(table, k - 3), p3)
        first = row + j * stride
        _store(sums, first, _add(_load(sums, first), _add(p0, q0)))
        if j + 1 < count:
            _store(sums, first + stride, _add(_load(sums, first + stride), _add(p1, q1)))
        if j + 2 < count:
            _store(sums, first + 2 * stride, _add(_load(sums, first + 2 * stride), _add(p2, q2)))
        if j + 3 < count:
            _store(sums, first + 3 * stride, _add(_load(sums, first + 3 * stride), _add(p3, q3)))


@njit(error_model="numpy", cache=True)
def _keep_ends(tables, segment, history, at, ends):  # type: ignore[no-untyped-def]
    """The filtered signals at ``at - lag`` for all lags, as rows ``signal * history + lag``."""
    for signal in range(4):
        for lag in range(1, history):
            row = signal * segment + history + at - lag
            _store(ends, signal * history + lag, _load(tables.filtered, row))


@njit(error_model="numpy", cache=True)
def _forget_decayed(table, row, size):  # type: ignore[no-untyped-def]
    """Zero the lanes of a stretch that died out: denormal numbers are a hundred times slower."""
    for lane in range(LANES):
        largest = 0.0
        for i in range(row, row + size):
            largest = max(largest, abs(table[i, lane]))
        if largest < DECAYED:
            for i in range(row, row + size):
                table[i, lane] = 0.0


@njit(error_model="numpy", cache=True)
def _gauss_newton(record, tables, lag_sums):  # type: ignore[no-untyped-def]
    """Upper triangle of ``sum_t J_t J_t'`` over the scored samples, for the loaded models.

    ``J = [y_F(t-i), u_F(t-nk-j), e_F(t-k), i_F(t-k)]``, the derivatives with respect to the signed
    ``[a, b, c, d]``, of signals filtered through 1/C (Ljung 1999, section 10.3), ``i`` an impulse
    at ``start``.  Only the first row and column of a block of lags are summed over the record; the
    others follow from their upper-left neighbours by exchanging the samples at its ends.
    ``lag_sums.sums`` is (n n, LANES), n the rows of a table of parameters.
    """
    heads, tails, sums = lag_sums
    c = record.na + record.nb
    width = c + 2 * record.rows_c
    counts = (record.na, record.nb, record.rows_c, record.rows_c)
    lags = (1, record.nk, 1, 0)
    places = (0, record.na, c, c + record.rows_c)
    history = heads.shape[0] // 4
    segment = history + CHUNK
    table = tables.filtered
    table[:] = 0.0
    sums[:] = 0.0
    for begin in range(record.start, record.y.size, CHUNK):
        end = min(begin + CHUNK, record.y.size)
        _filter_signals(record, tables, begin, end, segment, history)
        if begin <= record.first < end:
            _keep_ends(tables, segment, history, record.first - begin, heads)
        if begin < record.last <= end:
            _keep_ends(tables, segment, history, record.last - begin, tails)
        low, high = max(begin, record.first), min(end, record.last)
        size, now = high - low, history + low - begin
        for one in range(4):
            x = one * segment + now - lags[one]
            for other in range(one, 4):
                z = other * segment + now - lags[other]
                row = places[one] * width + places[other]
                if size > 0 and counts[one] > 0:
                    _add_products(table, x, z, size, counts[other], sums, row, 1)
                    if other > one and counts[other] > 0:
                        rest = counts[one] - 1
                        _add_products(table, z, x - 1, size, rest, sums, row + width, width)
        for signal in range(4):
            for row in range(signal * segment, signal * segment + history):
                _store(table, row, _load(table, row + end - begin))
        _forget_decayed(table, 3 * segment, history)
    minus = _constant(-1.0)
    for one in range(4):
        for other in range(one, 4):
            for i in range(1, counts[one]):
                for j in range(i if one == other else 1, counts[other]):
                    row = (places[one] + i) * width + places[other] + j
                    x, z = one * history + lags[one] + i, other * history + lags[other] + j
                    g = _fma(_load(heads, x), _load(heads, z), _load(sums, row - width - 1))
                    tail = _fma(_load(tails, x), minus, _constant(0.0))
                    _store(sums, row, _fma(tail, _load(tails, z), g))


@njit(error_model="numpy", cache=True)
def curvatures(  # type: ignore[no-untyped-def]
    record, objective, tables, lag_sums, bandwidth, points, corners
):
    """Gauss-Newton part of the Hessian of each row's objective, (M, n, n); rows must be feasible.

    For the absolute value with the mean second derivative of :func:`_mean_curvatures`, whose width
    is ``bandwidth`` in mean ``|e|``.
    """
    count, n = points.shape
    matrices = np.empty((count, n, n))
    width = tables.parameters.shape[0]
    state = record.na + record.nb + record.nc
    for begin in range(0, count, LANES):
        rows = np.arange(begin, min(begin + LANES, count))
        _load_points(record, points, rows, tables.parameters)
        _all_residuals(record, tables)
        if objective.absolute:
            _load_corners(corners, rows, tables)
            _mean_curvatures(record, tables, bandwidth)
        else:
            tables.total[:] = 2.0
        _gauss_newton(record, tables, lag_sums)
        for i in range(n):
            row = i if i < state else i - record.nc + record.rows_c
            own = -1.0 if record.na <= i < state else 1.0
            for j in range(i, n):
                column = j if j < state else j - record.nc + record.rows_c
                other = -1.0 if record.na <= j < state else 1.0
                for lane, r in enumerate(rows):
                    weight = objective.factor * own * other * tables.total[0, lane]
                    matrices[r, i, j] = weight * lag_sums.sums[row * width + column, lane]
                    matrices[r, j, i] = matrices[r, i, j]
        for r in rows:
            for i in range(state, n):
                matrices[r, i, i] += 2.0 * objective.state_weight
    return matrices


@njit(error_model="numpy", cache=True)
def schur_stable(coefficients, radius):  # type: ignore[no-untyped-def]
    """Whether all roots of ``1 + x_1 q^-1 + ... + x_m q^-m`` lie within ``radius``, row by row.

    Step-down (Schur-Cohn) test on the polynomial whose roots are divided by ``radius``.

    Parameters
    ----------
    coefficients : (models, m) float array, without the leading 1
    radius : float

    Returns
    -------
    (models,) bool array
    """
    models_count, m = coefficients.shape
    stable = np.ones(models_count, dtype=np.bool_)
    x = np.empty(m)
    for model in range(models_count):
        scale = 1.0
        for i in range(m):
            scale *= radius
            x[i] = coefficients[model, i] / scale
        for order in range(m, 0, -1):
            k = x[order - 1]
            if not abs(k) < 1.0:
                stable[model] = False
                break
            d = 1.0 / (1.0 - k * k)
            for i in range(order // 2):
                j = order - 2 - i
                head, tail = x[i], x[j]
                x[i] = (head - k * tail) * d
                x[j] = (tail - k * head) * d
    return stable


@njit(error_model="numpy", cache=True)
def feasible_rows(record, radius, points):  # type: ignore[no-untyped-def]
    """Whether A and C of each row are stable within ``radius``, and all of it finite."""
    noise = record.na + record.nb
    feasible = schur_stable(points[:, : record.na], radius)
    feasible &= schur_stable(points[:, noise : noise + record.nc], radius)
    for r in range(feasible.size):
        feasible[r] &= np.isfinite(points[r]).all()
    return feasible


@njit(error_model="numpy", cache=True)
def _barrier(coefficients, radius, work, slope):  # type: ignore[no-untyped-def]
    """One polynomial's barrier, see :func:`stability_barriers`; its gradient goes to ``slope``.

    Down through the orders, kept in ``work``, and back up by the adjoint of each step.
    """
    m = coefficients.size
    if m == 0:
        return 0.0
    value, scale = 0.0, 1.0
    for i in range(m):
        scale *= radius
        work[m, i] = coefficients[i] / scale
    for order in range(m, 0, -1):
        x, k = work[order], work[order, order - 1]
        if not abs(k) < 1.0:
            return np.inf
        value -= np.log1p(-k * k)
        d = 1.0 / (1.0 - k * k)
        for i in range(order - 1):
            work[order - 1, i] = (x[i] - k * x[order - 2 - i]) * d
    for order in range(1, m + 1):
        x, k, below = work[order], work[order, order - 1], work[order - 1]
        d = 1.0 / (1.0 - k * k)
        of_k = 2.0 * k * d
        for i in range(order - 1):
            of_k += slope[i] * (2.0 * k * below[i] - x[order - 2 - i]) * d
        for i in range(order // 2):
            j = order - 2 - i
            head, tail = slope[i], slope[j]
            slope[i] = (head - k * tail) * d
            slope[j] = (tail - k * head) * d
        slope[order - 1] = of_k
    scale = 1.0
    for i in range(m):
        scale *= radius
        slope[i] /= scale
    return value


@njit(error_model="numpy", cache=True)
def stability_barriers(coefficients, radius):  # type: ignore[no-untyped-def]
    """``-sum log(1 - k_i**2)`` over the reflection coefficients of each row's polynomial.

    It grows without bound as a root approaches ``radius``, and is the logarithm of the variance
    of white noise filtered through the polynomial's inverse, roots divided by ``radius``.

    Parameters
    ----------
    coefficients : (models, m) float array, without the leading 1
    radius : float

    Returns
    -------
    values (models,), infinite where a root lies outside; gradients (models, m)
    """
    models_count, m = coefficients.shape
    values = np.empty(models_count)
    gradients = np.zeros((models_count, m))
    work = np.empty((m + 1, m))
    for model in range(models_count):
        values[model] = _barrier(coefficients[model], radius, work, gradients[model])
    return values, gradients


@njit(error_model="numpy", cache=True)
def barrier_curvatures(coefficients, radius):  # type: ignore[no-untyped-def]
    """Gauss-Newton part of the second derivatives of :func:`stability_barriers`, (models, m, m)."""
    models_count, m = coefficients.shape
    curvature = np.zeros((models_count, m, m))
    x, next_x = np.empty(m), np.empty(m)
    slopes, next_slopes = np.empty((m, m)), np.empty((m, m))  # d x_i / d coefficient_j
    for model in range(models_count):
        scale = 1.0
        for i in range(m):
            scale *= radius
            x[i] = coefficients[model, i] / scale
            slopes[i, :] = 0.0
            slopes[i, i] = 1.0 / scale
        for order in range(m, 0, -1):
            k = x[order - 1]
            if not abs(k) < 1.0:
                curvature[model] = 0.0
                break
            d = 1.0 / (1.0 - k * k)
            own = slopes[order - 1]
            weight = 2.0 * (1.0 + k * k) * d * d
            for i in range(m):
                for j in range(m):
                    curvature[model, i, j] += weight * own[i] * own[j]
            for i in range(order - 1):
                mirror = order - 2 - i
                next_x[i] = (x[i] - k * x[mirror]) * d
                for j in range(m):
                    change = slopes[i, j] - k * slopes[mirror, j]
                    change += (2.0 * k * next_x[i] - x[mirror]) * own[j]
                    next_slopes[i, j] = change * d
            for i in range(order - 1):
                x[i] = next_x[i]
                for j in range(m):
                    slopes[i, j] = next_slopes[i, j]
    return curvature
