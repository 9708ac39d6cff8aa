"""Residuals of eight models in one pass over the record, and which models are allowed."""

from evopem.compilation import njit
from evopem.estimation.pem.kernels.record import BLOCK, MIN_NC, PAIR, fill
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
def load_eight(signal, row, step):
    """Rows ``row, row + step, ...`` of a table, or such samples of a signal."""
    return (
        load_either(signal, row),
        load_either(signal, row + step),
        load_either(signal, row + 2 * step),
        load_either(signal, row + 3 * step),
        load_either(signal, row + 4 * step),
        load_either(signal, row + 5 * step),
        load_either(signal, row + 6 * step),
        load_either(signal, row + 7 * step),
    )


@njit
def store_eight(table, row, step, s):
    """Write eight samples to rows ``row, row + step, ...``."""
    _store_block(table, row, step, s[0], s[1], s[2], s[3])
    _store_block(table, row + step * BLOCK, step, s[4], s[5], s[6], s[7])


@njit
def _store_block(table, row, step, s0, s1, s2, s3):
    store(table, row, s0)
    store(table, row + step, s1)
    store(table, row + 2 * step, s2)
    store(table, row + 3 * step, s3)


@njit
def sums_of_eight(s, w):
    """Eight samples plus eight others."""
    return (
        *(add(s[0], w[0]), add(s[1], w[1]), add(s[2], w[2]), add(s[3], w[3])),
        *(add(s[4], w[4]), add(s[5], w[5]), add(s[6], w[6]), add(s[7], w[7])),
    )


@njit
def _filter_block(parameters, c, nc, s0, s1, s2, s3, filtered, row, step):
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
    _store_block(filtered, row, step, s0, s1, s2, s3)
    return s0, s1, s2, s3


@njit
def filter_eight(parameters, c, nc, s, filtered, row, step):
    """Filter eight samples through 1/C into rows ``row, row + step, ...``, and return them.  The nc
    rows before, of backward filters (``step = -1``) behind, are known."""
    s0, s1, s2, s3 = _filter_block(parameters, c, nc, s[0], s[1], s[2], s[3], filtered, row, step)
    s4, s5, s6, s7 = _filter_block(
        parameters, c, nc, s[4], s[5], s[6], s[7], filtered, row + step * BLOCK, step
    )
    return s0, s1, s2, s3, s4, s5, s6, s7


@njit
def add_lags(parameters, at, count, signal, q, step, s):
    """Add ``sum_j parameters[at + j] signal[q + step (i - j)]`` to the i-th of eight samples.  Of a
    signal that all models share or of a table of their own ones."""
    s0, s1, s2, s3, s4, s5, s6, s7 = s
    w1, w2, w3, w4, w5, w6, w7, _ = load_eight(signal, q + step, step)
    for j in range(count):
        p, w0 = load(parameters, at + j), load_either(signal, q - step * j)
        s0, s1, s2, s3 = fma(p, w0, s0), fma(p, w1, s1), fma(p, w2, s2), fma(p, w3, s3)
        s4, s5, s6, s7 = fma(p, w4, s4), fma(p, w5, s5), fma(p, w6, s6), fma(p, w7, s7)
        w1, w2, w3, w4, w5, w6, w7 = w0, w1, w2, w3, w4, w5, w6
    return s0, s1, s2, s3, s4, s5, s6, s7


@njit
def _add_impulses(parameters, row, last, s):
    """Add the rows from ``row`` to ``last`` of a state to eight samples."""
    at = parameters, row, last, constant(0.0)
    w0, w1, w2, w3 = _impulse(0, *at), _impulse(1, *at), _impulse(2, *at), _impulse(3, *at)
    w4, w5, w6, w7 = _impulse(4, *at), _impulse(5, *at), _impulse(6, *at), _impulse(7, *at)
    return sums_of_eight(s, (w0, w1, w2, w3, w4, w5, w6, w7))


@njit
def _impulse(i, parameters, row, last, zero):
    return load(parameters, row + i) if row + i <= last else zero


@njit
def compute_residuals(record, workspace):
    """x_i, v and e of the loaded models, of the whole record.  Eight samples at a time keep the
    processor busy while a recursion waits for itself."""
    parameters, x, v, e = workspace.parameters, workspace.x, workspace.v, workspace.e
    y, u, layout = record.y, record.u, record.layout
    start, history = layout.residual_start, layout.history
    if x.shape[0] > 1:
        for i in range(layout.inputs):
            fill(x, i * layout.rows, i * layout.rows + history, 0.0)
    if layout.nd > 0:
        fill(v, 0, history, 0.0)
    fill(e, 0, history, 0.0)
    zero = constant(0.0)
    level = load(parameters, layout.at_level) if layout.level else zero
    for t in range(start, y.size, PAIR):
        since = t - start
        row = since + history
        s = (level, level, level, level, level, level, level, level)
        for i in range(layout.inputs):
            of = record.of_inputs[i]
            nf = of.nf
            q = i * y.size + t - of.nk
            if nf == 0:
                s = add_lags(parameters, of.at_b, of.nb, u, q, 1, s)
                continue
            w = (zero, zero, zero, zero, zero, zero, zero, zero)
            w = add_lags(parameters, of.at_b, of.nb, u, q, 1, w)
            if since < nf:
                state = of.at_g
                w = _add_impulses(parameters, state + since, state + nf - 1, w)
            row_at = i * layout.rows + row
            w = filter_eight(parameters, of.at_f, of.rows_f, w, x, row_at, 1)
            s = sums_of_eight(s, w)
        s = sums_of_eight(s, load_eight(y, t, 1))
        if layout.na > 0:
            s = add_lags(parameters, 0, layout.na, y, t - 1, 1, s)
        if layout.nd > 0:
            store_eight(v, row, 1, s)
            s = add_lags(parameters, layout.at_d, layout.nd, v, row - 1, 1, s)
        if since < layout.states:
            state = layout.at_s
            s = _add_impulses(parameters, state + since, state + layout.states - 1, s)
        if layout.nc > 0:
            filter_eight(parameters, layout.at_c, layout.rows_c, s, e, row, 1)
        else:
            store_eight(e, row, 1, s)


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
