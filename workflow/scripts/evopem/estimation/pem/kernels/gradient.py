"""Loss of a population and its gradient by the adjoint recursions, backwards through 1/C, D and
1/F_i: ``C* lam = l``, ``mu = D* lam``, ``F_i* xi_i = mu``, l the derivative of the loss by each
residual.  The gradient correlates one of these with the signal that a parameter multiplies."""

from functools import partial

import numpy as np

from evopem.compilation import allocating_njit, cached_njit, njit
from evopem.estimation.pem.kernels import bfgs
from evopem.estimation.pem.kernels.polynomials import barrier
from evopem.estimation.pem.kernels.record import (
    CHUNK,
    PAIR,
    Objective,
    Record,
    fill,
    load_points,
    load_smoothing,
    state_weight,
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

# What a pass is for.
RESIDUALS, VALUES, GRADIENTS = 0, 1, 2
# As parts: not compiled for Python as well, which most searches never need.
trial_points, advance = map(allocating_njit, (bfgs.trial_points.py_func, bfgs.advance.py_func))


@njit
def _slope(record, e, smoothing, absolute, t, loss):
    """Derivative of the loss by the residual of sample t, and ``loss`` plus the loss.  The absolute
    value is smoothed: ``sqrt(e**2 + smoothing**2)``."""
    zero = constant(0.0)
    if t < record.layout.loss_start or t >= record.loss_stop:
        return zero, loss
    value = load(e, t - record.layout.residual_start + record.layout.history)
    if absolute:
        width = load(smoothing, 0)
        r = square_root(fma(value, value, fma(width, width, zero)))
        return divide(value, r), add(loss, r)
    return add(value, value), fma(value, value, loss)


@njit
def _slopes(record, e, smoothing, absolute, t, loss):
    """The same of eight samples, from t on backwards."""
    s0, loss = _slope(record, e, smoothing, absolute, t, loss)
    s1, loss = _slope(record, e, smoothing, absolute, t - 1, loss)
    s2, loss = _slope(record, e, smoothing, absolute, t - 2, loss)
    s3, loss = _slope(record, e, smoothing, absolute, t - 3, loss)
    s4, loss = _slope(record, e, smoothing, absolute, t - 4, loss)
    s5, loss = _slope(record, e, smoothing, absolute, t - 5, loss)
    s6, loss = _slope(record, e, smoothing, absolute, t - 6, loss)
    s7, loss = _slope(record, e, smoothing, absolute, t - 7, loss)
    return (s0, s1, s2, s3, s4, s5, s6, s7), loss


@njit
def _correlate(s, signal, q, count, gradient, at):
    """``gradient[at + j] += sum_i s[i] signal[q - i - j]``: of a signal or a table.  The products
    keep the processor busy while a recursion waits for itself."""
    w0, w1, w2, w3, w4, w5, w6, _ = load_eight(signal, q, -1)
    for j in range(count):
        w7 = load_either(signal, q - j - 7)
        even = fma(s[0], w0, load(gradient, at + j))
        even = fma(s[6], w6, fma(s[4], w4, fma(s[2], w2, even)))
        odd = fma(s[5], w5, fma(s[3], w3, fma(s[1], w1, constant(0.0))))
        store(gradient, at + j, add(even, fma(s[7], w7, odd)))
        w0, w1, w2, w3, w4, w5, w6 = w1, w2, w3, w4, w5, w6, w7


@njit
def _add_sum(s, gradient, at):
    total = load(gradient, at)
    for value in s:
        total = add(total, value)
    store(gradient, at, total)


@njit
def _move(table, first, following, history):
    """The first rows of a stretch become the rows behind the stretch before it."""
    for k in range(history - 1, -1, -1):
        store(table, first + following + k, load(table, first + k))


@njit
def _loss_and_gradient(record, workspace, absolute):
    """Loss of the models whose residuals stand in the table, and its gradient by a pass back."""
    parameters, gradient = workspace.parameters, workspace.gradient
    y, u, layout = record.y, record.u, record.layout
    start, history = layout.residual_start, layout.history
    lam, xi = workspace.windows
    fill(gradient, 0, gradient.shape[0], 0.0)
    fill(lam, 0, lam.shape[0], 0.0)
    fill(xi, 0, xi.shape[0], 0.0)
    stretch = CHUNK + history
    loss, first = constant(0.0), np.intp(0)  # a bare 0 would be a type of its own
    end = y.size
    while True:
        begin = max(end - CHUNK, start)
        for t in range(end - 1, begin, -PAIR):
            now, row = t - begin, t - start + history
            s, loss = _slopes(record, workspace.e, workspace.smoothing, absolute, t, loss)
            if layout.nc > 0:
                s = filter_eight(parameters, layout.at_c, layout.rows_c, s, lam, now, -1)
                _correlate(s, workspace.e, row - 1, layout.nc, gradient, layout.at_c)
            if layout.nd > 0:
                store_eight(lam, now, -1, s)
                _correlate(s, workspace.v, row - 1, layout.nd, gradient, layout.at_d)
                s = add_lags(parameters, layout.at_d, layout.nd, lam, now + 1, -1, s)
            _correlate(s, y, t - 1, layout.na, gradient, first)
            if layout.level:
                _add_sum(s, gradient, layout.at_level)
            for i in range(layout.inputs):
                of, w = record.of_inputs[i], s
                nf, at = of.nf, of.at_f
                if nf > 0:
                    row_at = i * stretch + now
                    w = filter_eight(parameters, at, of.rows_f, s, xi, row_at, -1)
                    _correlate(w, workspace.x, i * layout.rows + row - 1, nf, gradient, at)
                q = i * y.size + t - of.nk
                _correlate(w, u, q, of.nb, gradient, of.at_b)
        if begin == start:
            break
        following = min(CHUNK, begin - start)
        _move(lam, first, following, history)
        for i in range(layout.inputs):
            if record.of_inputs[i].nf > 0:
                _move(xi, i * stretch, following, history)
        end = begin
    for i in range(layout.inputs):
        of = record.of_inputs[i]
        for k in range(of.nf):
            store(gradient, of.at_g + k, load(xi, i * stretch + k))
    for k in range(layout.states):
        store(gradient, layout.at_s + k, load(lam, k))
    return loss


@allocating_njit
def pass_over(record, objective, workspace, task, points, smoothing, barriers):
    """Residuals, values, or values and gradients of each row, (M,) and (M, n).  Residuals, of
    up to eight rows whether feasible or not, are left in ``workspace.e``."""
    count, n = points.shape
    values, gradients = np.full(count, np.inf), np.zeros((count, n))
    of_roots = _barriers(record, objective, points, gradients)
    allowed = np.nonzero((of_roots < np.inf) | (task == RESIDUALS))[0]
    first = record.layout.loss_start - record.layout.residual_start + record.layout.history
    last = record.loss_stop - record.layout.residual_start + record.layout.history
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
                finite = np.isfinite(slope).all()
            for k in range(n):
                square = points[r, k] * points[r, k]
                value += state_weight(record, objective, n, k) * square
            if np.isfinite(value) and finite:
                values[r] = value
    for r in range(count):
        if not np.isfinite(values[r]):
            for k in range(n):
                gradients[r, k] = 0.0
    return values, gradients


@allocating_njit
def _pass_over_all(
    record, stretches, objective, workspace, task, rows, points, smoothing, barriers
):
    """The sum of what passes over the stretches of each of some starts, ``rows``, give for it."""
    values, gradients = np.zeros(len(points)), np.zeros(points.shape)
    for k, at in enumerate(stretches.places):
        counted, owner = np.arange(len(points)), stretches.owners[k]
        if owner >= 0:
            counted = counted[rows == owner]
        ends, weights = stretches.ends[k], stretches.weights[k]
        signals = stretches.y[ends[0] : ends[1]], stretches.u[ends[2] : ends[3]]
        of_losses = weights[0], weights[1], weights[2]
        stretch = Record(*(signals + record[2:-1] + (ends[4],)))
        of_stretch = Objective(*(objective[:1] + of_losses + objective[4:]))
        of_rows = (
            points[counted][:, at],
            smoothing[counted],
            stretches.shares[k] * barriers[counted],
        )
        passed = pass_over(stretch, of_stretch, workspace, task, *of_rows)
        for j, r in enumerate(counted):
            values[r] += passed[0][j]
            for i in range(at.size):
                gradients[r, at[i]] += passed[1][j, i]
    return values, gradients


@allocating_njit
def _barriers(record, objective, points, gradients):
    """Barriers of all monic polynomials of each row, inf where a root lies outside, and gradients.
    The gradients go to their rows, which are zero."""
    order = record.layout.largest_order
    work = np.empty((order + 1, order))
    barriers = np.zeros(points.shape[0])
    for k in range(record.monic.shape[0]):
        low, high, of_plant = record.monic[k, 0], record.monic[k, 1], record.monic[k, 2]
        radius = objective.plant_radius if of_plant else objective.noise_radius
        for r in range(barriers.size):
            barriers[r] += barrier(points[r, low:high], radius, work, gradients[r, low:high])
    return barriers


@njit
def _unload_gradient(record, objective, table, lane, point, gradient):
    """Add one lane's gradient, with respect to the signed parameters, to a row of gradients."""
    for row in range(record.entry.size):
        index = record.entry[row]
        if index >= 0:
            gradient[index] += record.sign[row] * objective.factor * table[row, lane]
    for k in range(point.size):
        gradient[k] += 2.0 * state_weight(record, objective, point.size, k) * point[k]


@allocating_njit
def _placed(frames, rows, coordinates):
    """Points of coordinates in the frames of their rows."""
    points = np.empty(coordinates.shape)
    for k in range(len(rows)):
        for i in range(points.shape[1]):
            total = 0.0
            for j in range(points.shape[1]):
                total += frames[rows[k], i, j] * coordinates[k, j]
            points[k, i] = total + frames[rows[k], i, points.shape[1]]
    return points


@allocating_njit
def _along(frames, rows, slopes):
    """Gradients by the coordinates, of those by the points."""
    gradients = np.empty(slopes.shape)
    for k in range(len(rows)):
        for i in range(slopes.shape[1]):
            total = 0.0
            for j in range(slopes.shape[1]):
                total += frames[rows[k], j, i] * slopes[k, j]
            gradients[k, i] = total
    return gradients


@partial(cached_njit, meanwhile="evopem.estimation.pem.kernels.gauss_newton")
def passes(problem, task, state, smoothing, barriers, tolerance, limit, trials, few, frames):
    """Trials of all descents, until so many are made or no more than ``few`` descents go on.  No
    trials are a pass over the points of the state, so that all is compiled and loaded once.  With
    ``frames``, (M, n, n + 1), points are ``frames [z, 1]`` of the coordinates z that the state has.
    Returns trials, evaluations and what the last pass gave."""
    record, stretches, objective, workspace = problem
    made = evaluations = 0
    while True:
        rows = np.nonzero(state.line["active"])[0]
        trial = trial_points(state, rows) if trials else state.x
        points = _placed(frames, rows, trial) if len(frames) else trial
        values, slopes = _pass_over_all(
            *(record, stretches, objective, workspace, task, rows, points),
            *(smoothing[rows], barriers[rows]),
        )
        gradients = _along(frames, rows, slopes) if len(frames) else slopes
        if not trials:
            return made, evaluations, values, gradients
        evaluations += advance(state, rows, trial, values, gradients, tolerance, limit)
        made += 1
        going_on = 0
        for r in rows:
            going_on += state.line[r].active
        if made == trials or going_on <= few:
            return made, evaluations, values, gradients
