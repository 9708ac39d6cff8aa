"""Loss of the general polynomial model and its gradient by the adjoint recursions.

Backwards through 1/C, D and 1/F, with ``l`` the derivative of the loss by each residual:

    C* lam = l,    mu = D* lam,    F* xi = mu,

an asterisk for time reversed.  The gradient by a signed parameter is a correlation of one of these
with the signal that the parameter multiplies.
"""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit, njit
from evopem.estimation.pem.kernels.gradient import filter_block_back
from evopem.estimation.pem.kernels.polynomial_record import (
    load_polynomials,
    point_index,
    weighted_states,
)
from evopem.estimation.pem.kernels.polynomial_residuals import all_polynomial_residuals
from evopem.estimation.pem.kernels.record import (
    BLOCK,
    CHUNK,
    all_finite,
    fill,
    load_smoothing,
    marked_rows,
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
from evopem.estimation.pem.kernels.stability import barrier


@njit
def _slopes(record, workspace, absolute, slope, begin, end, s):
    """Derivative of the loss with respect to each residual, from row 0 on; ``s`` plus the losses.

    The absolute value is smoothed: ``sqrt(e**2 + smoothing**2)``.
    """
    zero, two = constant(0.0), constant(2.0)
    e, before = workspace.e, record.residual_start - record.history
    smoothing_squared = fma(load(workspace.smoothing, 0), load(workspace.smoothing, 0), zero)
    for t in range(begin, end):
        if t < record.loss_start or t >= record.loss_stop:
            store(slope, t - begin, zero)
        elif absolute:
            value = load(e, t - before)
            r = square_root(fma(value, value, smoothing_squared))
            s = add(s, r)
            store(slope, t - begin, divide(value, r))
        else:
            value = load(e, t - before)
            s = fma(value, value, s)
            store(slope, t - begin, fma(two, value, zero))
    return s


@njit
def _filter_back(parameters, at, rows, slope, size):
    """Filter ``size`` rows backwards through an inverse polynomial in place."""
    for row in range(size - 1, -1, -BLOCK):
        filter_block_back(parameters, at, rows, slope, row)


@njit
def _times_d_back(parameters, at, nd, slope, filtered, size):
    """Filter ``size`` rows backwards through D."""
    for row in range(0, size, BLOCK):
        s0, s1 = load(slope, row), load(slope, row + 1)
        s2, s3 = load(slope, row + 2), load(slope, row + 3)
        for k in range(nd):
            p, q = load(parameters, at + k), row + 1 + k
            s0, s1 = fma(p, load(slope, q), s0), fma(p, load(slope, q + 1), s1)
            s2, s3 = fma(p, load(slope, q + 2), s2), fma(p, load(slope, q + 3), s3)
        store(filtered, row, s0)
        store(filtered, row + 1, s1)
        store(filtered, row + 2, s2)
        store(filtered, row + 3, s3)


@njit
def _add_to_gradient(gradient, at, count, j, s0, s1, s2, s3):
    """Add up to four neighbouring sums."""
    store(gradient, at + j, add(load(gradient, at + j), s0))
    if j + 1 < count:
        store(gradient, at + j + 1, add(load(gradient, at + j + 1), s1))
    if j + 2 < count:
        store(gradient, at + j + 2, add(load(gradient, at + j + 2), s2))
    if j + 3 < count:
        store(gradient, at + j + 3, add(load(gradient, at + j + 3), s3))


@njit
def _correlate_signal(slope, size, signal, first, count, gradient, at):
    """``gradient[at + j] += sum_i slope[i] signal[first + i - j]``; up to three lags more read."""
    zero = constant(0.0)
    for j in range(0, count, 4):
        p0, p1, p2, p3 = zero, zero, zero, zero
        q0, q1, q2, q3 = zero, zero, zero, zero
        for i in range(0, size, 2):
            one, two, k = load(slope, i), load(slope, i + 1), first + i - j
            z0, z1, z2 = sample(signal, k), sample(signal, k - 1), sample(signal, k - 2)
            p0, p1, p2 = fma(one, z0, p0), fma(one, z1, p1), fma(one, z2, p2)
            p3 = fma(one, sample(signal, k - 3), p3)
            q0, q1 = fma(two, sample(signal, k + 1), q0), fma(two, z0, q1)
            q2, q3 = fma(two, z1, q2), fma(two, z2, q3)
        _add_to_gradient(gradient, at, count, j, add(p0, q0), add(p1, q1), add(p2, q2), add(p3, q3))


@njit
def _correlate_table(slope, size, table, first, count, gradient, at):
    """``gradient[at + j] += sum_i slope[i] table[first + i - j]``; up to three lags more read."""
    zero = constant(0.0)
    for j in range(0, count, 4):
        p0, p1, p2, p3 = zero, zero, zero, zero
        q0, q1, q2, q3 = zero, zero, zero, zero
        for i in range(0, size, 2):
            one, two, k = load(slope, i), load(slope, i + 1), first + i - j
            z0, z1, z2 = load(table, k), load(table, k - 1), load(table, k - 2)
            p0, p1, p2 = fma(one, z0, p0), fma(one, z1, p1), fma(one, z2, p2)
            p3 = fma(one, load(table, k - 3), p3)
            q0, q1 = fma(two, load(table, k + 1), q0), fma(two, z0, q1)
            q2, q3 = fma(two, z1, q2), fma(two, z2, q3)
        _add_to_gradient(gradient, at, count, j, add(p0, q0), add(p1, q1), add(p2, q2), add(p3, q3))


@njit
def _add_sum(slope, size, gradient, at):
    s = load(gradient, at)
    for i in range(size):
        s = add(s, load(slope, i))
    store(gradient, at, s)


@njit
def _move(table, following, history):
    """The first rows of a stretch become the rows behind the stretch before it."""
    for k in range(history - 1, -1, -1):
        store(table, following + k, load(table, k))


@njit
def _loss_and_gradient(record, workspace, absolute):
    """Loss of the loaded models, and by one backward pass its gradient, whatever their size."""
    all_polynomial_residuals(record, workspace)
    parameters, gradient = workspace.parameters, workspace.gradient
    fill(gradient, 0, gradient.shape[0], 0.0)
    lam, mu, xi = workspace.windows
    if record.nd == 0:
        mu = lam
    if record.nf == 0:
        xi = mu
    start, history = record.residual_start, record.history
    for table in workspace.windows:
        fill(table, 0, table.shape[0], 0.0)
    s = constant(0.0)
    end = record.y.size
    while True:
        begin = max(end - CHUNK, start)
        size, row = end - begin, begin - start + history
        s = _slopes(record, workspace, absolute, lam, begin, end, s)
        if record.nc > 0:
            _filter_back(parameters, record.at_c, record.rows_c, lam, size)
            _correlate_table(lam, size, workspace.e, row - 1, record.nc, gradient, record.at_c)
        if record.nd > 0:
            _correlate_table(lam, size, workspace.v, row - 1, record.nd, gradient, record.at_d)
            _times_d_back(parameters, record.at_d, record.nd, lam, mu, size)
        _correlate_signal(mu, size, record.y, begin - 1, record.na, gradient, 0)
        if record.level:
            _add_sum(mu, size, gradient, record.at_level)
        if record.nf > 0:
            for i in range(size):
                store(xi, i, load(mu, i))
            _filter_back(parameters, record.at_f, record.rows_f, xi, size)
            _correlate_table(xi, size, workspace.x, row - 1, record.nf, gradient, record.at_f)
        _correlate_signal(xi, size, record.u, begin - record.nk, record.nb, gradient, record.na)
        if begin == start:
            break
        following = min(CHUNK, begin - start)
        _move(lam, following, history)
        if record.nd > 0:
            _move(mu, following, history)
        if record.nf > 0:
            _move(xi, following, history)
        end = begin
    for k in range(record.nf):
        store(gradient, record.at_g + k, load(xi, k))
    for k in range(record.states):
        store(gradient, record.at_s + k, load(lam, k))
    return s


@cached_njit
def polynomial_values_and_gradients(record, objective, workspace, points, smoothing, barriers):
    """Smoothed objective of each row with a barrier added, and its gradient.

    The absolute value is smoothed, ``sqrt(e**2 + smoothing**2)``.  The barriers of A, C, D and F,
    times ``barriers``, are added.  Infeasible rows are inf and 0.
    """
    found = np.empty(points.shape[0])
    gradients = np.zeros(points.shape)
    c = record.na + record.nb
    d = c + record.nc
    f = d + record.nd
    g = f + record.nf
    plant, noise = objective.plant_radius, objective.noise_radius
    of_roots = np.empty(found.size)
    order = max(record.na, record.nc, record.nd, record.nf)
    work = np.empty((order + 1, order))
    for r in range(found.size):
        found[r] = np.inf
        x, slope = points[r], gradients[r]
        of_roots[r] = barrier(x[: record.na], plant, work, slope[: record.na])
        of_roots[r] += barrier(x[c:d], noise, work, slope[c:d])
        of_roots[r] += barrier(x[d:f], noise, work, slope[d:f])
        of_roots[r] += barrier(x[f:g], plant, work, slope[f:g])
    feasible = marked_rows(of_roots < np.inf)
    for i in range(0, feasible.size, LANES):
        rows = feasible[i : i + LANES]
        load_polynomials(record, points, rows, workspace.parameters)
        load_smoothing(smoothing, rows, workspace)
        store(workspace.total, 0, _loss_and_gradient(record, workspace, objective.absolute))
        for lane, r in enumerate(rows):
            for k in range(points.shape[1]):
                gradients[r, k] *= barriers[r]
            _unload_gradient(record, objective, workspace.gradient, lane, points[r], gradients[r])
            value = objective.factor * workspace.total[0, lane] + barriers[r] * of_roots[r]
            value += weighted_states(record, objective, points[r])
            if np.isfinite(value) and all_finite(gradients[r]):
                found[r] = value
    for r in range(found.size):
        if not np.isfinite(found[r]):
            for k in range(points.shape[1]):
                gradients[r, k] = 0.0
    return found, gradients


@njit
def _unload_gradient(record, objective, table, lane, point, gradient):
    """Add one lane's gradient, with respect to the signed parameters, to a row of gradients."""
    for row in range(record.rows):
        index, sign = point_index(record, row)
        if index >= 0:
            gradient[index] += sign * objective.factor * table[row, lane]
    at_s = point.size - record.states
    for k in range(at_s - record.nf, at_s):
        gradient[k] += 2.0 * objective.plant_state_weight * point[k]
    for k in range(at_s, point.size):
        gradient[k] += 2.0 * objective.noise_state_weight * point[k]
