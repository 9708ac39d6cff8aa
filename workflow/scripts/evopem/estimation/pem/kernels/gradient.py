"""Loss and its gradient by the adjoint recursion: one pass backwards through 1/C."""

from __future__ import annotations

from evopem.estimation.pem.kernels.cache import inlined, njit
from evopem.estimation.pem.kernels.record import (
    BLOCK,
    CHUNK,
    MIN_NC,
    fill,
)
from evopem.estimation.pem.kernels.residuals import kept_residuals, residuals_of_part
from evopem.estimation.pem.kernels.simd import (
    add,
    constant,
    divide,
    fma,
    load,
    sample,
    square_root,
    store,
)


@njit
def _slopes(record, workspace, absolute, slope, before, begin, end, s):
    """Derivative of the loss with respect to each residual, from row 0 on; ``s`` plus the losses.

    Row ``t - before`` of the residuals is sample t.  The absolute value is smoothed:
    ``sqrt(e**2 + smoothing**2)``.
    """
    zero, two = constant(0.0), constant(2.0)
    e = workspace.residuals
    smoothing_squared = fma(load(workspace.smoothing, 0), load(workspace.smoothing, 0), zero)
    for t in range(begin, end):
        if t < record.loss_start or t >= record.loss_stop:
            store(slope, t - begin, zero)
        elif absolute:
            v = load(e, t - before)
            r = square_root(fma(v, v, smoothing_squared))
            s = add(s, r)
            store(slope, t - begin, divide(v, r))
        else:
            v = load(e, t - before)
            s = fma(v, v, s)
            store(slope, t - begin, fma(two, v, zero))
    return s


@njit
def filter_block_back(parameters, c, nc, slope, row):
    """Filter rows ``row ... row - 3`` backwards through 1/C in place, and return them."""
    s0, s1 = load(slope, row), load(slope, row - 1)
    s2, s3 = load(slope, row - 2), load(slope, row - 3)
    q = row + nc
    w0, w1, w2 = load(slope, q), load(slope, q - 1), load(slope, q - 2)
    for k in range(nc - 1, MIN_NC - 1, -1):
        p, w3 = load(parameters, c + k), load(slope, row - 2 + k)
        s0, s1, s2, s3 = fma(p, w0, s0), fma(p, w1, s1), fma(p, w2, s2), fma(p, w3, s3)
        w0, w1, w2 = w1, w2, w3
    c1, c2, c3 = load(parameters, c), load(parameters, c + 1), load(parameters, c + 2)
    s0 = fma(c1, w2, fma(c2, w1, fma(c3, w0, s0)))
    s1 = fma(c1, s0, fma(c2, w2, fma(c3, w1, s1)))
    s2 = fma(c1, s1, fma(c2, s0, fma(c3, w2, s2)))
    s3 = fma(c1, s2, fma(c2, s1, fma(c3, s0, s3)))
    store(slope, row, s0)
    store(slope, row - 1, s1)
    store(slope, row - 2, s2)
    store(slope, row - 3, s3)
    return s0, s1, s2, s3


@njit
def _sweep_back(record, parameters, e, before, slope, begin, end, gradient):
    """Filter the slopes of a stretch backwards through 1/C, and correlate them with the signals.

    Row ``t - begin`` of ``slope`` and row ``t - before`` of ``e`` are sample t; the ``rows_c`` rows
    of slopes after the last are known.  The correlations keep the processor busy while the
    recursion waits for itself.
    """
    y, u, na, nb, nc = record.y, record.u, record.na, record.nb, record.rows_c
    zero = constant(0.0)
    c = na + nb
    for t in range(end - 1, begin, -2 * BLOCK):
        s0, s1, s2, s3 = filter_block_back(parameters, c, nc, slope, t - begin)
        s4, s5, s6, s7 = filter_block_back(parameters, c, nc, slope, t - begin - BLOCK)
        for i in range(na):
            q = t - 1 - i
            even = fma(s2, sample(y, q - 2), fma(s0, sample(y, q), load(gradient, i)))
            odd = fma(s3, sample(y, q - 3), fma(s1, sample(y, q - 1), zero))
            even = fma(s6, sample(y, q - 6), fma(s4, sample(y, q - 4), even))
            odd = fma(s7, sample(y, q - 7), fma(s5, sample(y, q - 5), odd))
            store(gradient, i, add(even, odd))
        for j in range(nb):
            row, q = na + j, t - record.nk - j
            even = fma(s2, sample(u, q - 2), fma(s0, sample(u, q), load(gradient, row)))
            odd = fma(s3, sample(u, q - 3), fma(s1, sample(u, q - 1), zero))
            even = fma(s6, sample(u, q - 6), fma(s4, sample(u, q - 4), even))
            odd = fma(s7, sample(u, q - 7), fma(s5, sample(u, q - 5), odd))
            store(gradient, row, add(even, odd))
        for k in range(nc):
            row, q = c + k, t - 1 - k - before
            even = fma(s2, load(e, q - 2), fma(s0, load(e, q), load(gradient, row)))
            odd = fma(s3, load(e, q - 3), fma(s1, load(e, q - 1), zero))
            even = fma(s6, load(e, q - 6), fma(s4, load(e, q - 4), even))
            odd = fma(s7, load(e, q - 7), fma(s5, load(e, q - 5), odd))
            store(gradient, row, add(even, odd))


@inlined
def loss_and_gradient(record, workspace, absolute):
    """Loss of the loaded models, and by one backward pass its gradient, whatever their size.

    The gradient, with respect to the signed parameters, goes to its table; the loss is returned.
    """
    kept, parts = kept_residuals(record, workspace)
    for part in range(parts):
        first, end = residuals_of_part(record, workspace, part)
    e, gradient = workspace.residuals, workspace.gradient
    fill(gradient, 0, gradient.shape[0], 0.0)
    slope, history, start = workspace.window, record.rows_c, record.residual_start
    fill(slope, 0, slope.shape[0], 0.0)
    s = constant(0.0)
    for part in range(parts - 1, -1, -1):
        if part < parts - 1:
            first, end = residuals_of_part(record, workspace, part)
        before = first - history
        while end > first:
            begin = max(end - CHUNK, first)
            s = _slopes(record, workspace, absolute, slope, before, begin, end, s)
            _sweep_back(record, workspace.parameters, e, before, slope, begin, end, gradient)
            if begin > start:
                following = min(CHUNK, begin - first) if begin > first else min(CHUNK, kept)
                for k in range(history - 1, -1, -1):
                    store(slope, following + k, load(slope, k))
            end = begin
    noise_state = record.na + record.nb + history
    for k in range(history):
        store(gradient, noise_state + k, load(slope, k))
    return s
