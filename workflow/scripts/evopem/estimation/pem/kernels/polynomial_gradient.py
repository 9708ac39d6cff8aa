"""Loss of the general polynomial model and its gradient by the adjoint recursions.

Backwards through 1/C, D and 1/F, with ``l`` the derivative of the loss by each residual:

    C* lam = l,    mu = D* lam,    F* xi = mu,

an asterisk for time reversed.  The gradient by a signed parameter is a correlation of one of these
with the signal that the parameter multiplies.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.cache import cached_njit, njit
from evopem.estimation.pem.kernels.gradient import filter_block_back
from evopem.estimation.pem.kernels.polynomial_record import (
    ANY_OBJECTIVE,
    PolynomialObjective,
    PolynomialRecord,
    PolynomialWorkspace,
    load_polynomials,
    point_index,
    weighted_states,
)
from evopem.estimation.pem.kernels.polynomial_residuals import (
    all_polynomial_residuals,
    feasible_polynomials,
)
from evopem.estimation.pem.kernels.record import (
    BLOCK,
    CHUNK,
    all_finite,
    fill,
    load_smoothing,
    marked_rows,
)
from evopem.estimation.pem.kernels.residuals import load_block, store_block, sum_of_losses
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
from evopem.estimation.pem.kernels.stability import barrier

Array = NDArray[np.float64]

# What a pass is for.
_RESIDUALS, _VALUES, _GRADIENTS = 0, 1, 2


@njit
def _slopes(record, workspace, absolute, slope, begin, end, s):
    """Derivative of the loss with respect to each residual, from row 0 on; ``s`` plus the losses.

    The absolute value is smoothed: ``sqrt(e**2 + smoothing**2)``.
    """
    zero = constant(0.0)
    e, before = workspace.e, record.residual_start - record.history
    smoothing_squared = fma(load(workspace.smoothing, 0), load(workspace.smoothing, 0), zero)
    low, high = max(begin, record.loss_start), max(begin, min(end, record.loss_stop))
    fill(slope, 0, low - begin, 0.0)
    fill(slope, high - begin, end - begin, 0.0)
    if absolute:
        for t in range(low, high):
            value = load(e, t - before)
            r = square_root(fma(value, value, smoothing_squared))
            s = add(s, r)
            store(slope, t - begin, divide(value, r))
        return s
    s1, s2, s3 = zero, zero, zero
    whole = low + (high - low) // BLOCK * BLOCK
    for t in range(low, whole, BLOCK):
        row, k = t - before, t - begin
        e0, e1, e2, e3 = load_block(e, row)
        s, s1, s2, s3 = fma(e0, e0, s), fma(e1, e1, s1), fma(e2, e2, s2), fma(e3, e3, s3)
        e0, e1, e2, e3 = add(e0, e0), add(e1, e1), add(e2, e2), add(e3, e3)
        store_block(slope, k, e0, e1, e2, e3)
    for t in range(whole, high):
        value = load(e, t - before)
        s = fma(value, value, s)
        store(slope, t - begin, add(value, value))
    return add(add(s, s1), add(s2, s3))


@njit
def _filter_back(parameters, at, rows, slope, size):
    """Filter ``size`` rows backwards through an inverse polynomial in place."""
    for row in range(size - 1, -1, -BLOCK):
        filter_block_back(parameters, at, rows, slope, row)


@njit
def _times_d_back(parameters, at, nd, slope, filtered, size):
    """Filter ``size`` rows backwards through D, eight at a time."""
    for row in range(0, size, 2 * BLOCK):
        s0, s1, s2, s3 = load_block(slope, row)
        s4, s5, s6, s7 = load_block(slope, row + BLOCK)
        w0, w1, w2, w3, w4, w5, w6 = s1, s2, s3, s4, s5, s6, s7
        for k in range(nd):
            p, w7 = load(parameters, at + k), load(slope, row + 2 * BLOCK + k)
            s0, s1, s2, s3 = fma(p, w0, s0), fma(p, w1, s1), fma(p, w2, s2), fma(p, w3, s3)
            s4, s5, s6, s7 = fma(p, w4, s4), fma(p, w5, s5), fma(p, w6, s6), fma(p, w7, s7)
            w0, w1, w2, w3, w4, w5, w6 = w1, w2, w3, w4, w5, w6, w7
        store_block(filtered, row, s0, s1, s2, s3)
        store_block(filtered, row + BLOCK, s4, s5, s6, s7)


@njit
def _four_lags(slope, size, signal, k):
    """``sum_i slope[i] signal[k + i - j]`` for ``j = 0 ... 3``; ``size`` is a multiple of four."""
    zero = constant(0.0)
    p0, p1, p2, p3 = zero, zero, zero, zero
    q0, q1, q2, q3 = zero, zero, zero, zero
    z1, z2, z3 = load_either(signal, k - 1), load_either(signal, k - 2), load_either(signal, k - 3)
    for i in range(0, size, BLOCK):
        one, two, row = load(slope, i), load(slope, i + 1), k + i
        y0, y1 = load_either(signal, row), load_either(signal, row + 1)
        p0, p1, p2, p3 = fma(one, y0, p0), fma(one, z1, p1), fma(one, z2, p2), fma(one, z3, p3)
        q0, q1, q2, q3 = fma(two, y1, q0), fma(two, y0, q1), fma(two, z1, q2), fma(two, z2, q3)
        one, two = load(slope, i + 2), load(slope, i + 3)
        y2, y3 = load_either(signal, row + 2), load_either(signal, row + 3)
        p0, p1, p2, p3 = fma(one, y2, p0), fma(one, y1, p1), fma(one, y0, p2), fma(one, z1, p3)
        q0, q1, q2, q3 = fma(two, y3, q0), fma(two, y2, q1), fma(two, y1, q2), fma(two, y0, q3)
        z1, z2, z3 = y3, y2, y1
    return add(p0, q0), add(p1, q1), add(p2, q2), add(p3, q3)


@njit
def _two_lags(slope, size, signal, k):
    """``sum_i slope[i] signal[k + i - j]`` for ``j = 0, 1``; ``size`` is a multiple of four."""
    zero = constant(0.0)
    p0, p1, q0, q1 = zero, zero, zero, zero
    r0, r1, s0, s1 = zero, zero, zero, zero
    z1 = load_either(signal, k - 1)
    for i in range(0, size, BLOCK):
        one, two, row = load(slope, i), load(slope, i + 1), k + i
        y0, y1 = load_either(signal, row), load_either(signal, row + 1)
        p0, p1, q0, q1 = fma(one, y0, p0), fma(one, z1, p1), fma(two, y1, q0), fma(two, y0, q1)
        one, two = load(slope, i + 2), load(slope, i + 3)
        y2, y3 = load_either(signal, row + 2), load_either(signal, row + 3)
        r0, r1, s0, s1 = fma(one, y2, r0), fma(one, y1, r1), fma(two, y3, s0), fma(two, y2, s1)
        z1 = y3
    return add(add(p0, r0), add(q0, s0)), add(add(p1, r1), add(q1, s1))


@njit
def _correlate(slope, size, signal, first, count, gradient, at):
    """``gradient[at + j] += sum_i slope[i] signal[first + i - j]``, of a signal or of a table."""
    for j in range(0, count, 4):
        if count - j > 2:
            s0, s1, s2, s3 = _four_lags(slope, size, signal, first - j)
            store(gradient, at + j + 2, add(load(gradient, at + j + 2), s2))
            if count - j > 3:
                store(gradient, at + j + 3, add(load(gradient, at + j + 3), s3))
        else:
            s0, s1 = _two_lags(slope, size, signal, first - j)
        store(gradient, at + j, add(load(gradient, at + j), s0))
        if count - j > 1:
            store(gradient, at + j + 1, add(load(gradient, at + j + 1), s1))


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
    """Loss of the models whose residuals stand in the table, and by one backward pass its gradient.

    The pass takes the same time whatever the number of parameters.
    """
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
            _correlate(lam, size, workspace.e, row - 1, record.nc, gradient, record.at_c)
        if record.nd > 0:
            _correlate(lam, size, workspace.v, row - 1, record.nd, gradient, record.at_d)
            _times_d_back(parameters, record.at_d, record.nd, lam, mu, size)
        _correlate(mu, size, record.y, begin - 1, record.na, gradient, 0)
        if record.level:
            _add_sum(mu, size, gradient, record.at_level)
        if record.nf > 0:
            for i in range(size):
                store(xi, i, load(mu, i))
            _filter_back(parameters, record.at_f, record.rows_f, xi, size)
            _correlate(xi, size, workspace.x, row - 1, record.nf, gradient, record.at_f)
        _correlate(xi, size, record.u, begin - record.nk, record.nb, gradient, record.na)
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
def _pass(record, objective, workspace, task, points, smoothing, barriers):
    """Residuals, values, or values and gradients: one function, compiled and loaded once.

    Residuals, of up to eight rows whether feasible or not, are left in ``workspace.e``.
    """
    count, n = points.shape
    found = np.full(count, np.inf)
    gradients = np.zeros((count if task == _GRADIENTS else 0, n))
    if task == _GRADIENTS:
        of_roots = _barriers(record, objective, points, gradients)
        allowed = marked_rows(of_roots < np.inf)
    elif task == _VALUES:
        of_roots = found
        allowed = marked_rows(feasible_polynomials(record, objective, points))
    else:
        of_roots = found
        allowed = np.arange(count)
    first = record.loss_start - record.residual_start + record.history
    last = record.loss_stop - record.residual_start + record.history
    for i in range(0, allowed.size, LANES):
        rows = allowed[i : i + LANES]
        load_polynomials(record, points, rows, workspace.parameters)
        all_polynomial_residuals(record, workspace)
        if task == _GRADIENTS:
            load_smoothing(smoothing, rows, workspace)
            store(workspace.total, 0, _loss_and_gradient(record, workspace, objective.absolute))
        elif task == _VALUES:
            s = sum_of_losses(workspace.e, objective.absolute, first, last, constant(0.0))
            store(workspace.total, 0, s)
        else:
            break
        for lane, r in enumerate(rows):
            value = objective.factor * workspace.total[0, lane]
            finite = True
            if task == _GRADIENTS:
                slope = gradients[r]
                for k in range(n):
                    slope[k] *= barriers[r]
                _unload_gradient(record, objective, workspace.gradient, lane, points[r], slope)
                value += barriers[r] * of_roots[r]
                finite = all_finite(slope)
            value += weighted_states(record, objective, points[r])
            if np.isfinite(value) and finite:
                found[r] = value
    for r in range(gradients.shape[0]):
        if not np.isfinite(found[r]):
            for k in range(n):
                gradients[r, k] = 0.0
    return found, gradients


@njit
def _barriers(record, objective, points, gradients):
    """Barriers of A, C, D and F of each row, inf where a root lies outside, and their gradients."""
    c = record.na + record.nb
    d = c + record.nc
    f = d + record.nd
    parts = ((0, record.na), (c, d), (d, f), (f, f + record.nf))
    plant, noise = objective.plant_radius, objective.noise_radius
    radii = (plant, noise, noise, plant)
    order = max(record.na, record.nc, record.nd, record.nf)
    work = np.empty((order + 1, order))
    found = np.zeros(points.shape[0])
    for r in range(found.size):
        for part in range(4):
            low, high = parts[part]
            found[r] += barrier(points[r, low:high], radii[part], work, gradients[r, low:high])
    return found


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


def polynomial_residuals(
    record: PolynomialRecord, workspace: PolynomialWorkspace, points: Array, rows: NDArray[np.intp]
) -> Array:
    """Residuals of up to eight rows of a population from the first on, (rows, samples).

    As many samples as the padded record has; those beyond the record have no meaning.
    """
    none = np.zeros(len(rows))
    _pass(
        record, ANY_OBJECTIVE, workspace, _RESIDUALS, np.ascontiguousarray(points[rows]), none, none
    )
    return workspace.e[record.history :, : len(rows)].T.copy()


def polynomial_values(
    record: PolynomialRecord,
    objective: PolynomialObjective,
    workspace: PolynomialWorkspace,
    points: Array,
) -> Array:
    """Objective of each row of a population, (M,); infeasible rows are inf."""
    none = np.zeros(len(points))
    values: Array = _pass(record, objective, workspace, _VALUES, points, none, none)[0]
    return values


def polynomial_values_and_gradients(
    record: PolynomialRecord,
    objective: PolynomialObjective,
    workspace: PolynomialWorkspace,
    points: Array,
    smoothing: Array,
    barriers: Array,
) -> tuple[Array, Array]:
    """Smoothed objective of each row with a barrier added, and its gradient.

    The absolute value is smoothed, ``sqrt(e**2 + smoothing**2)``.  The barriers of A, C, D and F,
    times ``barriers``, are added.  Infeasible rows are inf and 0.
    """
    found: tuple[Array, Array] = _pass(
        record, objective, workspace, _GRADIENTS, points, smoothing, barriers
    )
    return found
