"""Loss of a population and its gradient by the adjoint recursions, backwards through 1/C, D and
1/F_i: ``C* lam = l``, ``mu = D* lam``, ``F_i* xi_i = mu``, l the derivative of the loss by each
residual.  The gradient correlates one of these with the signal that a parameter multiplies."""

import numpy as np

from evopem.estimation.pem.kernels.bfgs import advance, trial_points
from evopem.estimation.pem.kernels.cache import cached_njit, njit
from evopem.estimation.pem.kernels.polynomials import barrier
from evopem.estimation.pem.kernels.record import (
    BLOCK,
    CHUNK,
    all_finite,
    fill,
    load_points,
    load_smoothing,
    marked_rows,
    monic_parts,
    state_weight,
)
from evopem.estimation.pem.kernels.residuals import (
    add_products,
    compute_residuals,
    filter_block,
    sum_of_losses,
    times_d,
)
from evopem.estimation.pem.kernels.simd import (
    LANES,
    add,
    constant,
    divide,
    fma,
    load,
    square_root,
    store,
)

# What a pass is for.
RESIDUALS, VALUES, GRADIENTS = 0, 1, 2


@njit
def _slopes(record, workspace, absolute, slope, begin, end, s):
    """Derivative of the loss with respect to each residual, from row 0 on; ``s`` plus the losses.
    The absolute value is smoothed: ``sqrt(e**2 + smoothing**2)``."""
    zero = constant(0.0)
    e, before = workspace.e, record.residual_start - record.history
    smoothing_squared = fma(load(workspace.smoothing, 0), load(workspace.smoothing, 0), zero)
    # Within the stretch: the rows behind it are known.
    low = min(max(begin, record.loss_start), end)
    high = max(low, min(end, record.loss_stop))
    fill(slope, 0, low - begin, 0.0)
    fill(slope, high - begin, end - begin, 0.0)
    for t in range(low, high):
        value = load(e, t - before)
        if absolute:
            r = square_root(fma(value, value, smoothing_squared))
            s = add(s, r)
            store(slope, t - begin, divide(value, r))
        else:
            s = fma(value, value, s)
            store(slope, t - begin, add(value, value))
    return s


@njit
def _filter_back(parameters, at, rows, slope, first, size):
    """Filter ``size`` rows from ``first`` on backwards through an inverse polynomial in place."""
    for row in range(first + size - 1, first - 1, -BLOCK):
        s0, s1 = load(slope, row), load(slope, row - 1)
        s2, s3 = load(slope, row - 2), load(slope, row - 3)
        filter_block(parameters, at, rows, s0, s1, s2, s3, slope, row, -1)


@njit
def _add_sum(slope, size, gradient, at):
    s = load(gradient, at)
    for i in range(size):
        s = add(s, load(slope, i))
    store(gradient, at, s)


@njit
def _move(table, first, following, history):
    """The first rows of a stretch become the rows behind the stretch before it."""
    for k in range(history - 1, -1, -1):
        store(table, first + following + k, load(table, first + k))


@njit
def _loss_and_gradient(record, workspace, absolute):
    """Loss of the models whose residuals stand in the table, and its gradient by a pass back."""
    parameters, gradient = workspace.parameters, workspace.gradient
    fill(gradient, 0, gradient.shape[0], 0.0)
    lam, mu, xi = workspace.windows
    if record.nd == 0:
        mu = lam
    start, history = record.residual_start, record.history
    stretch = CHUNK + history
    for table in workspace.windows:
        fill(table, 0, table.shape[0], 0.0)
    s = constant(0.0)
    end = record.y.size
    while True:
        begin = max(end - CHUNK, start)
        size, row = end - begin, begin - start + history
        s = _slopes(record, workspace, absolute, lam, begin, end, s)
        if record.nc > 0:
            _filter_back(parameters, record.at_c, record.rows_c, lam, 0, size)
            add_products(lam, 0, size, workspace.e, row - 1, record.nc, gradient, record.at_c, 1)
        if record.nd > 0:
            add_products(lam, 0, size, workspace.v, row - 1, record.nd, gradient, record.at_d, 1)
            times_d(parameters, record.at_d, record.nd, lam, mu, 0, size, -1)
        add_products(mu, 0, size, record.y, begin - 1, record.na, gradient, 0, 1)
        if record.level:
            _add_sum(mu, size, gradient, record.at_level)
        for i in range(record.inputs):
            own, first, nf = mu, 0, record.nf[i]
            if nf > 0:
                own, first, at = xi, i * stretch, record.at_f[i]
                for k in range(size):
                    store(xi, first + k, load(mu, k))
                _filter_back(parameters, at, record.rows_f[i], xi, first, size)
                x = i * record.rows + row - 1
                add_products(xi, first, size, workspace.x, x, nf, gradient, at, 1)
            u = i * record.y.size + begin - record.nk[i]
            add_products(own, first, size, record.u, u, record.nb[i], gradient, record.at_b[i], 1)
        if begin == start:
            break
        following = min(CHUNK, begin - start)
        _move(lam, 0, following, history)
        if record.nd > 0:
            _move(mu, 0, following, history)
        for i in range(record.inputs):
            if record.nf[i] > 0:
                _move(xi, i * stretch, following, history)
        end = begin
    for i in range(record.inputs):
        for k in range(record.nf[i]):
            store(gradient, record.at_g[i] + k, load(xi, i * stretch + k))
    for k in range(record.states):
        store(gradient, record.at_s + k, load(lam, k))
    return s


@njit
def pass_over(record, objective, workspace, task, points, smoothing, barriers):
    """Residuals, values, or values and gradients of each row, (M,) and (M, n).  Residuals, of
    up to eight rows whether feasible or not, are left in ``workspace.e``."""
    count, n = points.shape
    found, gradients = np.full(count, np.inf), np.zeros((count, n))
    of_roots = _barriers(record, objective, points, gradients)
    allowed = np.arange(count) if task == RESIDUALS else marked_rows(of_roots < np.inf)
    first = record.loss_start - record.residual_start + record.history
    last = record.loss_stop - record.residual_start + record.history
    for i in range(0, allowed.size, LANES):
        rows = allowed[i : i + LANES]
        load_points(record, points, rows, workspace.parameters)
        compute_residuals(record, workspace)
        if task == GRADIENTS:
            load_smoothing(smoothing, rows, workspace)
            store(workspace.total, 0, _loss_and_gradient(record, workspace, objective.absolute))
        elif task == VALUES:
            s = sum_of_losses(workspace.e, objective.absolute, first, last, constant(0.0))
            store(workspace.total, 0, s)
        else:
            break
        for lane, r in enumerate(rows):
            value = objective.factor * workspace.total[0, lane]
            finite = True
            if task == GRADIENTS:
                slope = gradients[r]
                for k in range(n):
                    slope[k] *= barriers[r]
                _unload_gradient(record, objective, workspace.gradient, lane, points[r], slope)
                value += barriers[r] * of_roots[r]
                finite = all_finite(slope)
            for k in range(n):
                square = points[r, k] * points[r, k]
                value += state_weight(record, objective, n, k) * square
            if np.isfinite(value) and finite:
                found[r] = value
    for r in range(count):
        if not np.isfinite(found[r]):
            for k in range(n):
                gradients[r, k] = 0.0
    return found, gradients


@njit
def _barriers(record, objective, points, gradients):
    """Barriers of all monic polynomials of each row, inf where a root lies outside, and gradients.
    The gradients go to their rows, which are zero."""
    parts, radii = monic_parts(record, objective)
    order = np.max(parts[:, 1] - parts[:, 0])
    work = np.empty((order + 1, order))
    found = np.zeros(points.shape[0])
    for r in range(found.size):
        for k in range(radii.size):
            low, high = parts[k]
            found[r] += barrier(points[r, low:high], radii[k], work, gradients[r, low:high])
    return found


@njit
def _unload_gradient(record, objective, table, lane, point, gradient):
    """Add one lane's gradient, with respect to the signed parameters, to a row of gradients."""
    for row in range(record.entry.size):
        index = record.entry[row]
        if index >= 0:
            gradient[index] += record.sign[row] * objective.factor * table[row, lane]
    for k in range(point.size):
        gradient[k] += 2.0 * state_weight(record, objective, point.size, k) * point[k]


@cached_njit
def passes(
    record, objective, workspace, task, state, smoothing, barriers, tolerance, limit, trials, few
):
    """Trials of all descents, until so many are made or no more than ``few`` descents go on.  No
    trials are a pass over the points of the state, so that all is compiled and loaded once.
    Returns trials, evaluations and what the last pass gave."""
    made = evaluations = 0
    while True:
        rows = marked_rows(state.line["active"])
        trial = trial_points(state, rows) if trials else state.x
        values, gradients = pass_over(
            record, objective, workspace, task, trial, smoothing[rows], barriers[rows]
        )
        if not trials:
            return made, evaluations, values, gradients
        evaluations += advance(state, rows, trial, values, gradients, tolerance, limit)
        made += 1
        going_on = 0
        for r in rows:
            going_on += state.line[r].active
        if made == trials or going_on <= few:
            return made, evaluations, values, gradients
