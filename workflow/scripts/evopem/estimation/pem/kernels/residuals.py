"""Residuals of eight models in one pass over the record, and the values of the objective."""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit, njit
from evopem.estimation.pem.kernels.record import (
    BLOCK,
    CHUNK,
    MIN_NC,
    fill,
    load_points,
    marked_rows,
    squared_state,
)
from evopem.estimation.pem.kernels.simd import (
    LANES,
    add,
    constant,
    fma,
    load,
    magnitude,
    sample,
    store,
)
from evopem.estimation.pem.kernels.stability import feasible_rows


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
def filter_block(parameters, c, nc, s0, s1, s2, s3, filtered, row):
    """Filter four samples through 1/C into rows ``row ... row + 3``, and return them.

    The nc rows before are known.
    """
    q = row - nc
    w0, w1, w2 = load(filtered, q), load(filtered, q + 1), load(filtered, q + 2)
    for k in range(nc - 1, MIN_NC - 1, -1):
        p, w3 = load(parameters, c + k), load(filtered, row + 2 - k)
        s0, s1, s2, s3 = fma(p, w0, s0), fma(p, w1, s1), fma(p, w2, s2), fma(p, w3, s3)
        w0, w1, w2 = w1, w2, w3
    c1, c2, c3 = load(parameters, c), load(parameters, c + 1), load(parameters, c + 2)
    s0 = fma(c1, w2, fma(c2, w1, fma(c3, w0, s0)))
    s1 = fma(c1, s0, fma(c2, w2, fma(c3, w1, s1)))
    s2 = fma(c1, s1, fma(c2, s0, fma(c3, w2, s2)))
    s3 = fma(c1, s2, fma(c2, s1, fma(c3, s0, s3)))
    store_block(filtered, row, s0, s1, s2, s3)
    return s0, s1, s2, s3


@njit
def _residuals(record, parameters, e, before, begin, end):
    """Residuals ``C e = A y - B u + d`` of eight models at ``begin <= t < end``, whole blocks.

    Row ``t - before`` of ``e`` is sample t; the ``rows_c`` rows before the first are known.
    """
    y, u, na, nb, nc = record.y, record.u, record.na, record.nb, record.rows_c
    start = record.residual_start
    c = na + nb
    for t in range(begin, end, BLOCK):
        s0, s1, s2, s3 = sample(y, t), sample(y, t + 1), sample(y, t + 2), sample(y, t + 3)
        if t < start + nc:
            row, last = c + nc + t - start, c + 2 * nc - 1
            s0 = add(s0, load(parameters, row))
            if row + 1 <= last:
                s1 = add(s1, load(parameters, row + 1))
            if row + 2 <= last:
                s2 = add(s2, load(parameters, row + 2))
            if row + 3 <= last:
                s3 = add(s3, load(parameters, row + 3))
        for i in range(na):
            p, q = load(parameters, i), t - 1 - i
            s0, s1 = fma(p, sample(y, q), s0), fma(p, sample(y, q + 1), s1)
            s2, s3 = fma(p, sample(y, q + 2), s2), fma(p, sample(y, q + 3), s3)
        for j in range(nb):
            p, q = load(parameters, na + j), t - record.nk - j
            s0, s1 = fma(p, sample(u, q), s0), fma(p, sample(u, q + 1), s1)
            s2, s3 = fma(p, sample(u, q + 2), s2), fma(p, sample(u, q + 3), s3)
        row = t - before
        filter_block(parameters, c, nc, s0, s1, s2, s3, e, row)


@njit
def kept_residuals(record, workspace):
    """Number of residuals that are kept, and of the parts of the record that it makes."""
    kept = workspace.residuals.shape[0] - record.rows_c
    return kept, -(-(record.y.size - record.residual_start) // kept)


@njit
def residuals_of_part(record, workspace, part):
    """Residuals of the loaded models in a part of the record, after the part before it.

    They are meaningless beyond the record.  Returns the first sample of the part and the one after
    its last; sample t is row ``t - first + rows_c``.
    """
    e, ends, history = workspace.residuals, workspace.ends, record.rows_c
    kept = e.shape[0] - history
    begin = record.residual_start + part * kept
    end = min(begin + kept, record.y.size)
    for k in range(history):
        store(e, k, load(ends, part * history + k))
    _residuals(record, workspace.parameters, e, begin - history, begin, end)
    for k in range(history):
        store(ends, (part + 1) * history + k, load(e, end - begin + k))
    return begin, end


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


@cached_njit
def values(record, objective, workspace, points):
    """Objective of each row of a population, (M,); infeasible rows are inf.

    Only as much of the residuals is kept as the recursion looks back on.
    """
    found = np.empty(points.shape[0])
    for r in range(found.size):
        found[r] = np.inf
    feasible = marked_rows(feasible_rows(record, objective.max_root_radius, points))
    history = record.rows_c
    for i in range(0, feasible.size, LANES):
        rows = feasible[i : i + LANES]
        load_points(record, points, rows, workspace.parameters)
        fill(workspace.window, 0, history, 0.0)
        s = constant(0.0)
        for begin in range(record.residual_start, record.y.size, CHUNK):
            end = min(begin + CHUNK, record.y.size)
            before = begin - history
            _residuals(record, workspace.parameters, workspace.window, before, begin, end)
            first = max(begin, record.loss_start) - before
            last = min(end, record.loss_stop) - before
            s = sum_of_losses(workspace.window, objective.absolute, first, last, s)
            for k in range(history):
                store(workspace.window, k, load(workspace.window, end - begin + k))
        store(workspace.total, 0, s)
        for lane, r in enumerate(rows):
            value = objective.factor * workspace.total[0, lane]
            value += objective.state_weight * squared_state(record, points[r])
            if np.isfinite(value):
                found[r] = value
    return found
