"""A pass over the record for one model alone: the lanes of a vector are samples, or lags.

Descents end one after the other, and most passes are left with one or two of them.  A recursion is
a chain of numbers whatever shares its pass, but all else takes an eighth of the work.  Each sum has
the order of :mod:`.gradient`, so that the bits are the same.
"""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit, inlined, njit
from evopem.estimation.pem.kernels.gradient import filter_block_back
from evopem.estimation.pem.kernels.record import BLOCK, CHUNK
from evopem.estimation.pem.kernels.residuals import filter_block, kept_residuals, load_block
from evopem.estimation.pem.kernels.simd import (
    LANES,
    add,
    constant,
    divide,
    flat,
    fma,
    load,
    load_run,
    sample,
    square_root,
    store,
    store_run,
)


@njit
def _load_point(record, point, parameters):
    """Signed parameters of a point, and as many zeros as a vector is wide."""
    noise = record.na + record.nb
    state = noise + record.rows_c
    for k in range(state + record.rows_c + LANES):
        parameters[k] = 0.0
    for i in range(record.na):
        parameters[i] = point[i]
    for i in range(record.na, noise + record.nc):
        parameters[i] = -point[i]
    for k in range(record.nc):
        parameters[state + k] = point[noise + record.nc + k]


@njit
def _residuals(record, parameters, e):
    """Residuals ``C e = A y - B u + d`` of the whole record, after the ``rows_c`` zeros before."""
    y, u, na, nb, nc = record.y, record.u, record.na, record.nb, record.rows_c
    start, c = record.residual_start, na + nb
    for row in range(nc):
        store(e, row, 0.0)
    for t in range(start, y.size, LANES):
        row = nc + t - start
        s = load_run(y, t)
        if t < start + nc:
            s = add(s, load_run(parameters, c + row))
        for i in range(na):
            s = fma(sample(parameters, i), load_run(y, t - 1 - i), s)
        for j in range(nb):
            s = fma(sample(parameters, na + j), load_run(u, t - record.nk - j), s)
        store_run(e, row, s)
    for row in range(nc, nc + y.size - start, BLOCK):
        s0, s1, s2, s3 = load_block(e, row)
        filter_block(parameters, c, nc, s0, s1, s2, s3, e, row)


@cached_njit
def residuals(record, point):
    """Residuals of a point, (padded samples,).

    Zero before ``residual_start``, meaningless beyond the record.
    """
    start, history = record.residual_start, record.rows_c
    parameters = np.empty(record.na + record.nb + 2 * history + LANES)
    e, found = np.empty(record.y.size - start + history), np.empty(record.y.size)
    _load_point(record, point, parameters)
    _residuals(record, parameters, e)
    for t in range(start):
        found[t] = 0.0
    for t in range(start, found.size):
        found[t] = e[t - start + history]
    return found


@njit
def _slopes(record, absolute, smoothing, e, slope, losses, begin, end):
    """Derivatives of the losses of a stretch by its residuals, and what the losses are sums of.

    The latter, sizes or residuals, stand from ``losses`` on; both are 0 where no loss counts.
    """
    zero, two = constant(0.0), constant(2.0)
    smoothing_squared = constant(fma(smoothing, smoothing, 0.0))
    before = record.residual_start - record.rows_c
    for t in range(begin, end, LANES):
        v = load_run(e, t - before)
        if absolute:
            r = square_root(fma(v, v, smoothing_squared))
            store_run(slope, losses + t - begin, r)
            store_run(slope, t - begin, divide(v, r))
        else:
            store_run(slope, losses + t - begin, v)
            store_run(slope, t - begin, fma(two, v, zero))
    for t in range(begin, min(record.loss_start, end)):
        store(slope, t - begin, 0.0)
        store(slope, losses + t - begin, 0.0)
    for t in range(max(record.loss_stop, begin), end):
        store(slope, t - begin, 0.0)
        store(slope, losses + t - begin, 0.0)


@njit
def _sum_of_losses(absolute, losses, begin, s):
    """``s`` plus eight losses."""
    if absolute:
        for row in range(begin, begin + LANES):
            s += load(losses, row)
    else:
        for row in range(begin, begin + LANES):
            s = fma(load(losses, row), load(losses, row), s)
    return s


@njit
def _correlate(signal, last, count, slopes, sums, first):
    """Add the products of eight slopes with a signal at ``count`` lags, the longest lag first.

    ``last`` is the sample of the last slope less the longest lag.
    """
    s0, s1, s2, s3, s4, s5, s6, s7 = slopes
    for k in range(0, count, LANES):
        q = last + k
        even = fma(
            s2, load_run(signal, q - 2), fma(s0, load_run(signal, q), load_run(sums, first + k))
        )
        odd = fma(s3, load_run(signal, q - 3), fma(s1, load_run(signal, q - 1), constant(0.0)))
        even = fma(s6, load_run(signal, q - 6), fma(s4, load_run(signal, q - 4), even))
        odd = fma(s7, load_run(signal, q - 7), fma(s5, load_run(signal, q - 5), odd))
        store_run(sums, first + k, add(even, odd))


@njit
def _whole_runs(count):
    return -(-count // LANES) * LANES


@inlined
def loss_and_gradient_of_one(record, workspace, absolute, point, smoothing):
    """Loss of a model, the absolute value smoothed by a number.

    The gradient goes to the first column of its table; the loss is returned.
    """
    na, nb, nc, start = record.na, record.nb, record.rows_c, record.residual_start
    c = na + nb
    parameters, e = flat(workspace.parameters), flat(workspace.residuals)
    slope, sums = flat(workspace.window), flat(workspace.filtered)
    _load_point(record, point, parameters)
    _residuals(record, parameters, e)
    of_u = _whole_runs(na)
    of_e = of_u + _whole_runs(nb)
    for k in range(of_e + _whole_runs(nc)):
        store(sums, k, 0.0)
    losses = CHUNK + nc
    for row in range(losses):
        store(slope, row, 0.0)
    s = 0.0
    kept, parts = kept_residuals(record, workspace)
    for part in range(parts - 1, -1, -1):
        first = start + part * kept
        end = min(first + kept, record.y.size)
        while end > first:
            begin = max(end - CHUNK, first)
            _slopes(record, absolute, smoothing, e, slope, losses, begin, end)
            # Sums and correlations keep the processor busy while the recursion waits for itself.
            for t in range(end - 1, begin, -2 * BLOCK):
                s = _sum_of_losses(absolute, slope, losses + end - 1 - t, s)
                s0, s1, s2, s3 = filter_block_back(parameters, c, nc, slope, t - begin)
                s4, s5, s6, s7 = filter_block_back(parameters, c, nc, slope, t - begin - BLOCK)
                slopes = (
                    *(constant(s0), constant(s1), constant(s2), constant(s3)),
                    *(constant(s4), constant(s5), constant(s6), constant(s7)),
                )
                _correlate(record.y, t - na, na, slopes, sums, 0)
                _correlate(record.u, t - record.nk - nb + 1, nb, slopes, sums, of_u)
                _correlate(e, t - start, nc, slopes, sums, of_e)
            if begin > start:
                following = min(CHUNK, begin - first) if begin > first else min(CHUNK, kept)
                for k in range(nc - 1, -1, -1):
                    store(slope, following + k, load(slope, k))
            end = begin
    gradient = workspace.gradient
    for i in range(na):
        gradient[i, 0] = load(sums, na - 1 - i)
    for j in range(nb):
        gradient[na + j, 0] = load(sums, of_u + nb - 1 - j)
    for k in range(nc):
        gradient[c + k, 0] = load(sums, of_e + nc - 1 - k)
        gradient[c + nc + k, 0] = load(slope, k)
    return s
