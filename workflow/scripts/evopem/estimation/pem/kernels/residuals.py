"""Residuals of eight models in one pass over the record, and which models are allowed."""

from evopem.estimation.pem.kernels.cache import njit
from evopem.estimation.pem.kernels.record import BLOCK, CHUNK, MIN_NC, fill
from evopem.estimation.pem.kernels.simd import (
    add,
    constant,
    fma,
    load,
    load_either,
    magnitude,
    store,
)


@njit
def load_block(table, row):
    """Rows ``row ... row + 3`` of a table."""
    return load(table, row), load(table, row + 1), load(table, row + 2), load(table, row + 3)


@njit
def store_block(table, row, s0, s1, s2, s3):
    """Write four samples to rows ``row ... row + 3``."""
    store(table, row, s0)
    store(table, row + 1, s1)
    store(table, row + 2, s2)
    store(table, row + 3, s3)


@njit
def filter_block(parameters, c, nc, s0, s1, s2, s3, filtered, row, step):
    """Filter four samples through 1/C into rows ``row ... row + 3 step``, and return them.  The nc
    rows before, of backward filters (``step = -1``) behind, are known."""
    q = row - step * nc
    w0, w1, w2 = load(filtered, q), load(filtered, q + step), load(filtered, q + 2 * step)
    for k in range(nc - 1, MIN_NC - 1, -1):
        p, w3 = load(parameters, c + k), load(filtered, row + step * (2 - k))
        s0, s1, s2, s3 = fma(p, w0, s0), fma(p, w1, s1), fma(p, w2, s2), fma(p, w3, s3)
        w0, w1, w2 = w1, w2, w3
    c1, c2, c3 = load(parameters, c), load(parameters, c + 1), load(parameters, c + 2)
    s0 = fma(c1, w2, fma(c2, w1, fma(c3, w0, s0)))
    s1 = fma(c1, s0, fma(c2, w2, fma(c3, w1, s1)))
    s2 = fma(c1, s1, fma(c2, s0, fma(c3, w2, s2)))
    s3 = fma(c1, s2, fma(c2, s1, fma(c3, s0, s3)))
    store(filtered, row, s0)
    store(filtered, row + step, s1)
    store(filtered, row + 2 * step, s2)
    store(filtered, row + 3 * step, s3)
    return s0, s1, s2, s3


@njit
def times_d(parameters, at, nd, source, filtered, row, size, step):
    """Filter ``size`` rows through D, backwards in time with ``step = -1``."""
    for i in range(row, row + size):
        s = load(source, i)
        for k in range(nd):
            s = fma(load(parameters, at + k), load(source, i - step * (1 + k)), s)
        store(filtered, i, s)


@njit
def add_products(one, x, size, other, z, count, sums, row, stride):
    """``sums[row + j stride] += sum_i one[x + i] other[z + i - j]`` for ``0 <= j < count``, of a
    signal or a table.  Four lags share what they load; up to four rows before are read."""
    zero = constant(0.0)
    for j in range(0, count, 4):
        p0, p1, p2, p3 = zero, zero, zero, zero
        q0, q1, q2, q3 = zero, zero, zero, zero
        k = z - j
        z1, z2, z3 = load_either(other, k - 1), load_either(other, k - 2), load_either(other, k - 3)
        for i in range(0, size - 1, 2):
            v, w = load(one, x + i), load(one, x + i + 1)
            y0, y1 = load_either(other, k + i), load_either(other, k + i + 1)
            p0, p1, p2, p3 = fma(v, y0, p0), fma(v, z1, p1), fma(v, z2, p2), fma(v, z3, p3)
            q0, q1, q2, q3 = fma(w, y1, q0), fma(w, y0, q1), fma(w, z1, q2), fma(w, z2, q3)
            z1, z2, z3 = y1, y0, z1
        if size % 2:
            v = load(one, x + size - 1)
            p0, p1 = fma(v, load_either(other, k + size - 1), p0), fma(v, z1, p1)
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
def _add_impulses(parameters, row, last, s0, s1, s2, s3):
    """Add the rows ``row ... row + 3`` of a state, as far as ``last``, to four samples."""
    if row <= last:
        s0 = add(s0, load(parameters, row))
    if row + 1 <= last:
        s1 = add(s1, load(parameters, row + 1))
    if row + 2 <= last:
        s2 = add(s2, load(parameters, row + 2))
    if row + 3 <= last:
        s3 = add(s3, load(parameters, row + 3))
    return s0, s1, s2, s3


@njit
def _add_lags(parameters, at, count, signal, q, s0, s1, s2, s3, s4, s5, s6, s7):
    """Add ``sum_j parameters[at + j] signal[q + i - j]`` to the i-th of eight samples.  Of a signal
    that all models share or of a table of their own ones."""
    w1, w2, w3 = load_either(signal, q + 1), load_either(signal, q + 2), load_either(signal, q + 3)
    w4, w5, w6 = load_either(signal, q + 4), load_either(signal, q + 5), load_either(signal, q + 6)
    w7 = load_either(signal, q + 7)
    for j in range(count):
        p, w0 = load(parameters, at + j), load_either(signal, q - j)
        s0, s1, s2, s3 = fma(p, w0, s0), fma(p, w1, s1), fma(p, w2, s2), fma(p, w3, s3)
        s4, s5, s6, s7 = fma(p, w4, s4), fma(p, w5, s5), fma(p, w6, s6), fma(p, w7, s7)
        w1, w2, w3, w4, w5, w6, w7 = w0, w1, w2, w3, w4, w5, w6
    return s0, s1, s2, s3, s4, s5, s6, s7


@njit
def _add_output(y, t, s0, s1, s2, s3):
    """Add four samples of the output."""
    s0, s1 = add(s0, load_either(y, t)), add(s1, load_either(y, t + 1))
    return s0, s1, add(s2, load_either(y, t + 2)), add(s3, load_either(y, t + 3))


@njit
def _respond_directly(parameters, at, nb, u, q, totals, size):
    """Add ``-B u`` of some samples, from ``u[q]`` on, to the totals."""
    for k in range(0, size, 2 * BLOCK):
        s0, s1, s2, s3 = load_block(totals, k)
        s4, s5, s6, s7 = load_block(totals, k + BLOCK)
        s0, s1, s2, s3, s4, s5, s6, s7 = _add_lags(
            parameters, at, nb, u, q + k, s0, s1, s2, s3, s4, s5, s6, s7
        )
        store_block(totals, k, s0, s1, s2, s3)
        store_block(totals, k + BLOCK, s4, s5, s6, s7)


@njit
def _respond(parameters, at, nb, u, q, at_f, rows_f, at_g, nf, since, x, row, totals, size):
    """Write x_i of some samples to its table from ``row`` on, and add it to the totals.  ``since``
    is the number of samples since the first residual, which the state counts from."""
    zero, last = constant(0.0), at_g + nf - 1
    for k in range(0, size, 2 * BLOCK):
        s0, s1, s2, s3, s4, s5, s6, s7 = _add_lags(
            parameters, at, nb, u, q + k, zero, zero, zero, zero, zero, zero, zero, zero
        )
        if since + k < nf:
            state = at_g + since + k
            s0, s1, s2, s3 = _add_impulses(parameters, state, last, s0, s1, s2, s3)
            s4, s5, s6, s7 = _add_impulses(parameters, state + BLOCK, last, s4, s5, s6, s7)
        s0, s1, s2, s3 = filter_block(parameters, at_f, rows_f, s0, s1, s2, s3, x, row + k, 1)
        s4, s5, s6, s7 = filter_block(
            parameters, at_f, rows_f, s4, s5, s6, s7, x, row + k + BLOCK, 1
        )
        p0, p1, p2, p3 = load_block(totals, k)
        p4, p5, p6, p7 = load_block(totals, k + BLOCK)
        store_block(totals, k, add(p0, s0), add(p1, s1), add(p2, s2), add(p3, s3))
        store_block(totals, k + BLOCK, add(p4, s4), add(p5, s5), add(p6, s6), add(p7, s7))


@njit
def _noise(parameters, y, na, at_c, nc, rows_c, at_d, nd, at_s, states, v, e, totals, t, row, size):
    """v and e of some samples from t on, to their tables from ``row`` on.  ``totals`` are the sums
    of all x_i and of the level.  ``states`` of the noise state are left."""
    last = at_s + states - 1
    for k in range(0, size, 2 * BLOCK):
        now, other = row + k, row + k + BLOCK
        s0, s1, s2, s3 = load_block(totals, k)
        s4, s5, s6, s7 = load_block(totals, k + BLOCK)
        s0, s1, s2, s3 = _add_output(y, t + k, s0, s1, s2, s3)
        s4, s5, s6, s7 = _add_output(y, t + k + BLOCK, s4, s5, s6, s7)
        if na > 0:
            s0, s1, s2, s3, s4, s5, s6, s7 = _add_lags(
                parameters, 0, na, y, t + k - 1, s0, s1, s2, s3, s4, s5, s6, s7
            )
        if nd > 0:
            store_block(v, now, s0, s1, s2, s3)
            store_block(v, other, s4, s5, s6, s7)
            s0, s1, s2, s3, s4, s5, s6, s7 = _add_lags(
                parameters, at_d, nd, v, now - 1, s0, s1, s2, s3, s4, s5, s6, s7
            )
        if k < states:
            s0, s1, s2, s3 = _add_impulses(parameters, at_s + k, last, s0, s1, s2, s3)
            s4, s5, s6, s7 = _add_impulses(parameters, at_s + k + BLOCK, last, s4, s5, s6, s7)
        if nc > 0:
            filter_block(parameters, at_c, rows_c, s0, s1, s2, s3, e, now, 1)
            filter_block(parameters, at_c, rows_c, s4, s5, s6, s7, e, other, 1)
        else:
            store_block(e, now, s0, s1, s2, s3)
            store_block(e, other, s4, s5, s6, s7)


@njit
def compute_residuals(record, workspace):
    """x_i, v and e of the loaded models, of the whole record.  Eight samples at a time keep the
    processor busy while a recursion waits for itself."""
    parameters, x, v, e = workspace.parameters, workspace.x, workspace.v, workspace.e
    start, history, totals = record.residual_start, record.history, workspace.totals
    if x.shape[0] > 1:
        for i in range(record.inputs):
            fill(x, i * record.rows, i * record.rows + history, 0.0)
    if record.nd > 0:
        fill(v, 0, history, 0.0)
    fill(e, 0, history, 0.0)
    level = load(parameters, record.at_level) if record.level else constant(0.0)
    for begin in range(start, record.y.size, CHUNK):
        size, row = min(CHUNK, record.y.size - begin), begin - start + history
        for k in range(size):
            store(totals, k, level)
        for i in range(record.inputs):
            at, nb, nf = record.at_b[i], record.nb[i], record.nf[i]
            q = i * record.y.size + begin - record.nk[i]
            if nf == 0:
                _respond_directly(parameters, at, nb, record.u, q, totals, size)
            else:
                f, rows_f, g = record.at_f[i], record.rows_f[i], record.at_g[i]
                own = i * record.rows + row
                _respond(
                    *(parameters, at, nb, record.u, q, f, rows_f, g, nf, begin - start),
                    *(x, own, totals, size),
                )
        # The noise state and what is left of it: all its rows lie in the first stretches.
        states = max(record.states - (begin - start), 0)
        _noise(
            *(parameters, record.y, record.na, record.at_c, record.nc, record.rows_c),
            *(record.at_d, record.nd, record.at_s + record.states - states, states),
            *(v, e, totals, begin, row, size),
        )


@njit
def sum_of_losses(e, absolute, begin, end, s):
    """``s`` plus the sum of ``|e|`` or ``e**2`` over rows of a table, lane by lane."""
    if absolute:
        for row in range(begin, end):
            s = add(s, magnitude(load(e, row)))
    else:
        for row in range(begin, end):
            v = load(e, row)
            s = fma(v, v, s)
    return s
