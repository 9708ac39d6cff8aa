"""Gauss-Newton matrices from products of delayed copies of filtered signals (Ljung 1999, section
10.3), by the signed parameters: ``(D/C) y``, ``(D/CF_i) u_i``, ``(1/C) e``, ``(1/C) v``, ``(D/CF_i)
x_i``, ``(D/C) 1``, and with an impulse i ``(D/CF_i) i`` and ``(1/C) i``.  A further copy of y or
u_i differs by the sample that enters it from the past, times the response to an impulse."""

import numpy as np

from evopem.compilation import allocating_njit, cached_njit, njit
from evopem.estimation.pem.kernels import polynomials
from evopem.estimation.pem.kernels.record import (
    CHUNK,
    LEVEL,
    NOISE_STATE,
    OF_A,
    OF_B,
    OF_C,
    OF_D,
    OF_F,
    PAIR,
    PLANT_STATE,
    Objective,
    fill,
    lag_sums_for,
    load_points,
    load_smoothing,
    record_of,
    state_weight,
    workspace_for,
)
from evopem.estimation.pem.kernels.residuals import (
    add_lags,
    compute_residuals,
    filter_eight,
    load_eight,
    store_eight,
    sum_of_losses,
)
from evopem.estimation.pem.kernels.simd import (
    LANES,
    add,
    constant,
    divide,
    fma,
    load,
    load_either,
    square_root,
    store,
)
from evopem.models.orders import Orders
from evopem.models.recursions import driven_states

# Magnitude below which an impulse response has died out.
DECAYED = 1e-40


@njit
def _mean_second_derivatives(record, workspace, bandwidth):
    """Mean second derivative of ``sqrt(e**2 + width**2)`` over the residuals, to ``total``.  Twice
    a kernel estimate of their density at zero, ``width`` being ``bandwidth`` in mean ``|e|`` but no
    narrower than the smoothing."""
    zero, before = constant(0.0), record.layout.residual_start - record.layout.history
    first, last = record.layout.loss_start - before, record.loss_stop - before
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


@njit
def _fill_source(record, workspace, source, part, begin, end):
    """A stretch of the signal that the first coefficient of a part multiplies."""
    kind, i, start = part[0], part[1], record.layout.residual_start
    before = start - record.layout.history
    for t in range(begin, end):
        if kind == OF_A:
            s = load_either(record.y, t - 1)
        elif kind == OF_B:
            s = load_either(record.u, i * record.y.size + t - record.of_inputs[i].nk)
        elif kind == OF_C:
            s = load(workspace.e, t - 1 - before)
        elif kind == OF_D:
            s = load(workspace.v, t - 1 - before)
        elif kind == OF_F:
            s = load(workspace.x, i * record.layout.rows + t - 1 - before)
        else:
            s = constant(1.0 if kind == LEVEL or t == start else 0.0)
        store(source, t - begin, s)


@njit
def _through_c_alone(kind):
    """Whether the signal of a part is filtered through 1/C alone."""
    return kind in (OF_C, OF_D, NOISE_STATE)


@njit
def _through_f(record, part):
    """Whether the signal of a part is filtered through an 1/F_i."""
    kind, i = part[0], part[1]
    return kind in (OF_B, OF_F, PLANT_STATE) and record.of_inputs[i].nf > 0


@njit
def _filter_source(record, parameters, buffers, part, row, size):
    """Filter a stretch to row ``row`` of the tables; the rows before are known."""
    source, by_c, by_d, by_f = buffers.source, buffers.by_c, buffers.by_d, buffers.by_f
    through_f = _through_f(record, part)
    for k in range(0, size, PAIR):
        s, now = load_eight(source, k, 1), row + k
        if record.layout.nc > 0:
            s = filter_eight(parameters, record.layout.at_c, record.layout.rows_c, s, by_c, now, 1)
        else:
            store_eight(by_c, now, 1, s)
        if _through_c_alone(part[0]):
            continue
        if record.layout.nd > 0:
            s = add_lags(parameters, record.layout.at_d, record.layout.nd, by_c, now - 1, 1, s)
            store_eight(by_d, now, 1, s)
        if through_f:
            at, rows = record.of_inputs[part[1]].at_f, record.of_inputs[part[1]].rows_f
            filter_eight(parameters, at, rows, s, by_f, now, 1)


@njit
def _table_of(record, part, by_c, by_d, by_f):
    """The table that holds the filtered signal of a part."""
    if _through_c_alone(part[0]):
        return by_c
    if _through_f(record, part):
        return by_f
    if record.layout.nd > 0:
        return by_d
    return by_c


@njit
def _forget_decayed(table, row, size):
    """Zero the lanes of a stretch that died out: denormal numbers are a hundred times slower.
    Returns whether any lane is left."""
    alive = False
    for lane in range(LANES):
        largest = 0.0
        for i in range(row, row + size):
            largest = max(largest, abs(table[i, lane]))
        if largest < DECAYED:
            for i in range(row, row + size):
                table[i, lane] = 0.0
        else:
            alive = True
    return alive


@njit
def _keep_ends(record, buffers, segment, history, at, ends):
    """The filtered signals at ``at - lag`` for all lags, as rows ``part * history + lag``."""
    tables = buffers.by_c, buffers.by_d, buffers.by_f
    for p in range(buffers.parts.shape[0]):
        table = _table_of(record, buffers.parts[p], *tables)
        for lag in range(1, history):
            row = p * segment + history + at - lag
            store(ends, p * history + lag, load(table, row))


@njit
def _keep_last(buffers, segment, history, size, alive):
    """What the next stretch looks back on, and which parts are not zero from now on."""
    for p in range(buffers.parts.shape[0]):
        left = False
        for table in (buffers.by_c, buffers.by_d, buffers.by_f):
            if table.shape[0] > 1:
                for row in range(p * segment, p * segment + history):
                    store(table, row, load(table, row + size))
                if buffers.parts[p, 0] >= PLANT_STATE:
                    left |= _forget_decayed(table, p * segment, history)
        left |= buffers.parts[p, 0] < PLANT_STATE
        if alive[p] and not left:
            # Not filled again, and the ends of the record may be among these rows.
            for table in (buffers.by_c, buffers.by_d, buffers.by_f):
                if table.shape[0] > 1:
                    fill(table, p * segment, (p + 1) * segment, 0.0)
        alive[p] = left


@njit
def _add_products(table, x, size, past, z, count, sums, row, stride):
    """``sums[row + j stride] += sum_i one[x + i] other[z + i - j]`` for ``0 <= j < count``, of a
    signal or a table.  Four lags share what they load; up to four rows before are read."""
    zero = constant(0.0)
    for j in range(0, count, 4):
        p0, p1, p2, p3 = zero, zero, zero, zero
        q0, q1, q2, q3 = zero, zero, zero, zero
        k = z - j
        z1, z2, z3 = load_either(past, k - 1), load_either(past, k - 2), load_either(past, k - 3)
        for i in range(0, size - 1, 2):
            v, w = load(table, x + i), load(table, x + i + 1)
            y0, y1 = load_either(past, k + i), load_either(past, k + i + 1)
            p0, p1, p2, p3 = fma(v, y0, p0), fma(v, z1, p1), fma(v, z2, p2), fma(v, z3, p3)
            q0, q1, q2, q3 = fma(w, y1, q0), fma(w, y0, q1), fma(w, z1, q2), fma(w, z2, q3)
            z1, z2, z3 = y1, y0, z1
        if size % 2:
            v = load(table, x + size - 1)
            p0, p1 = fma(v, load_either(past, k + size - 1), p0), fma(v, z1, p1)
            p2, p3 = fma(v, z2, p2), fma(v, z3, p3)
        first = row + j * stride
        store(sums, first, add(load(sums, first), add(p0, q0)))
        if j + 1 < count:
            store(sums, first + stride, add(load(sums, first + stride), add(p1, q1)))
        if j + 2 < count:
            store(sums, first + 2 * stride, add(load(sums, first + 2 * stride), add(p2, q2)))
        if j + 3 < count:
            store(sums, first + 3 * stride, add(load(sums, first + 3 * stride), add(p3, q3)))


@njit
def _add_products_of_parts(record, buffers, segment, now, size, alive):
    """Add the products of ``size`` samples: the first row and column of each pair of parts."""
    parts, sums = buffers.parts, buffers.sums
    width, tables = buffers.width, (buffers.by_c, buffers.by_d, buffers.by_f)
    # A bare 1 would be a type of its own, which the products would be compiled for once more.
    next_row = np.intp(1)
    for p in range(parts.shape[0]):
        of_p, x, copies = _table_of(record, parts[p], *tables), p * segment + now, parts[p, 2]
        for q in range(p, parts.shape[0]):
            if not (alive[p] and alive[q]):
                continue
            of_q, z = _table_of(record, parts[q], *tables), q * segment + now
            row = parts[p, 3] * width + parts[q, 3]
            _add_products(of_p, x, size, of_q, z, parts[q, 2], sums, row, next_row)
            if q > p:
                _add_products(of_q, z, size, of_p, x - 1, copies - 1, sums, row + width, width)


@njit
def _complete_sums(buffers):
    """The products of all other copies, from those of their first ones.  Each follows from its
    upper-left neighbour by exchanging the samples at the record's ends."""
    parts, sums, heads, tails = buffers.parts, buffers.sums, buffers.heads, buffers.tails
    width, history = buffers.width, buffers.history
    minus = constant(-1.0)
    for p in range(parts.shape[0]):
        for q in range(p, parts.shape[0]):
            for i in range(1, parts[p, 2]):
                for j in range(i if p == q else 1, parts[q, 2]):
                    row = (parts[p, 3] + i) * width + parts[q, 3] + j
                    x, z = p * history + i, q * history + j
                    g = fma(load(heads, x), load(heads, z), load(sums, row - width - 1))
                    tail = fma(load(tails, x), minus, constant(0.0))
                    store(sums, row, fma(tail, load(tails, z), g))
    for i in range(width):
        for j in range(i):
            store(sums, i * width + j, load(sums, j * width + i))


@njit
def _add_responses(record, buffers):
    """Add what enters the copies of y and u_i from the past, to the rows."""
    parts, sums, width = buffers.parts, buffers.sums, buffers.width
    for p in range(parts.shape[0]):
        if parts[p, 6] < 0:
            continue
        kind, i, response = parts[p, 0], parts[p, 1], parts[parts[p, 6], 3]
        for copy in range(1, parts[p, 2]):
            for lag in range(1, copy + 1):
                if kind == OF_A:
                    past = load_either(record.y, record.layout.residual_start - 1 - lag)
                else:
                    t = record.layout.residual_start - record.of_inputs[i].nk - lag
                    past = load_either(record.u, i * record.y.size + t)
                into, source = (parts[p, 3] + copy) * width, (response + copy - lag) * width
                for k in range(width):
                    s = fma(past, load(sums, source + k), load(sums, into + k))
                    store(sums, into + k, s)


@njit
def _transpose(buffers):
    """Rows of the sums to columns."""
    sums, width = buffers.sums, buffers.width
    for i in range(width):
        for j in range(i):
            of_row, of_column = load(sums, i * width + j), load(sums, j * width + i)
            store(sums, i * width + j, of_column)
            store(sums, j * width + i, of_row)


@allocating_njit
def _gauss_newton(record, workspace, buffers):
    """``sum_t J_t J_t'`` over the samples that count, for the loaded models, to ``buffers.sums``.
    By the copies of :class:`.record.LagSums`."""
    parts, sums, heads, history = buffers.parts, buffers.sums, buffers.heads, buffers.history
    segment = history + CHUNK
    for table in (buffers.by_c, buffers.by_d, buffers.by_f, sums):
        fill(table, 0, table.shape[0], 0.0)
    alive = np.ones(parts.shape[0], dtype=np.bool_)
    for begin in range(record.layout.residual_start, record.y.size, CHUNK):
        end = min(begin + CHUNK, record.y.size)
        for p in range(parts.shape[0]):
            if alive[p]:
                _fill_source(record, workspace, buffers.source, parts[p], begin, end)
                row = p * segment + history
                _filter_source(record, workspace.parameters, buffers, parts[p], row, end - begin)
        if begin <= record.layout.loss_start < end:
            _keep_ends(record, buffers, segment, history, record.layout.loss_start - begin, heads)
        if begin < record.loss_stop <= end:
            _keep_ends(record, buffers, segment, history, record.loss_stop - begin, buffers.tails)
        low, high = max(begin, record.layout.loss_start), min(end, record.loss_stop)
        if high > low:
            now = history + low - begin
            _add_products_of_parts(record, buffers, segment, now, high - low, alive)
        _keep_last(buffers, segment, history, end - begin, alive)
    _complete_sums(buffers)
    # The sums are symmetric before: to the rows twice, as columns follow each other in memory.
    _add_responses(record, buffers)
    _transpose(buffers)
    _add_responses(record, buffers)


@njit
def _unload_sums(record, objective, weights, buffers, rows, matrices):
    """Write the loaded models' sums, by the entries of a point and weighted, to their matrices."""
    parts, width = buffers.parts, buffers.width
    for p in range(parts.shape[0]):
        for q in range(parts.shape[0]):
            for row_of_p in range(parts[p, 4]):
                for row_of_q in range(parts[q, 4]):
                    a, b = parts[p, 5] + row_of_p, parts[q, 5] + row_of_q
                    i, j = record.entry[a], record.entry[b]
                    sign = objective.factor * record.sign[a] * record.sign[b]
                    row = (parts[p, 3] + row_of_p) * width + parts[q, 3] + row_of_q
                    for lane, r in enumerate(rows):
                        matrices[r, i, j] = sign * weights[0, lane] * buffers.sums[row, lane]


@cached_njit
def gauss_newton_matrices(record, objective, workspace, buffers, bandwidth, points, smoothing):
    """Gauss-Newton part of the Hessian of each feasible row's objective, (M, n, n); of the absolute
    value with :func:`_mean_second_derivatives`, ``bandwidth`` in mean ``|e|``."""
    count, n = points.shape
    matrices = np.zeros((count, n, n))
    for begin in range(0, count, LANES):
        rows = np.arange(begin, min(begin + LANES, count))
        load_points(record, points, rows, workspace.parameters)
        compute_residuals(record, workspace)
        if objective.absolute:
            load_smoothing(smoothing, rows, workspace)
            _mean_second_derivatives(record, workspace, bandwidth)
        else:
            store(workspace.total, 0, constant(2.0))
        _gauss_newton(record, workspace, buffers)
        _unload_sums(record, objective, workspace.total, buffers, rows, matrices)
        for r in rows:
            for i in range(n):
                matrices[r, i, i] += 2.0 * state_weight(record, objective, n, i)
    return matrices


def compile_kernels() -> None:
    """Compile, and keep, what a first search needs beside its passes."""
    orders = Orders(na=1, nb=(1,), nc=1, nd=0, nf=(0,), nk=(1,))
    record = record_of(np.zeros(9), np.zeros((9, 1)), orders, False, 1, 1)
    buffers = workspace_for(record), lag_sums_for(record, False)
    objective = Objective(False, 1.0, 1.0, 1.0, 1.0, 1.0)
    gauss_newton_matrices(record, objective, *buffers, 1.0, np.zeros((1, 4)), np.ones(1))
    polynomials.filter_rows(np.zeros((1, 1)), np.ones(2), np.zeros((1, 1)))
    driven_states(np.zeros((1, 1)), np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), np.array([0, 1]))
