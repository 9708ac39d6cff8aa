"""BFGS for many starts at once, in lockstep, so that they share the passes of the objective."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.arrays import Array, Flags, Indices
from evopem.compilation import allocating_njit, cached_njit, njit

SUFFICIENT_DECREASE = 1e-4
CURVATURE = 0.9
LONGEST_LINE_SEARCH = 30
# Least part of a bracket that an interpolated step keeps.
SHORTEST_CUT = 0.1

# What the line search of a start knows, as one array: each costs time at compilation and at a call.
LINE = np.dtype(
    [
        *((name, np.float64) for name in ("value", "slope", "step", "low", "high")),
        *((name, np.int64) for name in ("tries", "iterations")),
        *((name, np.bool_) for name in ("converged", "active", "unaimed")),
    ],
    align=True,
)


class State(NamedTuple):
    """Where each start is, its gradient, inverse Hessian, direction and line search."""

    x: Array
    g: Array
    h: Array
    d: Array
    line: NDArray[np.void]


def state_at(starts: Array) -> State:
    """The state of descents whose starts, (M, n), have not been evaluated yet."""
    count, dimension = starts.shape
    line = np.zeros(count, LINE)
    line["active"] = True
    g, d = np.zeros((2, count, dimension))
    return State(starts, g, np.zeros((count, dimension, dimension)), d, line)


@partial(cached_njit, is_quick=True)
def trial_points(state: State, rows: Indices) -> Array:
    """The point that each of some starts tries."""
    trial = np.empty((rows.size, state.x.shape[1]))
    for k, r in enumerate(rows):
        if state.line[r].unaimed:
            _aim(state, r)
        for i in range(trial.shape[1]):
            trial[k, i] = state.x[r, i] + state.line[r].step * state.d[r, i]
    return trial


@partial(cached_njit, is_quick=True)
def advance(
    state: State,
    rows: Indices,
    trial: Array,
    values: Array,
    gradients: Array,
    tolerance: float,
    max_iterations: int,
) -> int:
    """Accept each start's trial, or say where along the line it tries next.  Returns the
    evaluations: steps out of the stability region are refused without residuals."""
    evaluations = 0
    for k, r in enumerate(rows):
        evaluations += np.isfinite(values[k])
        state.line[r].tries += 1
        step, slope = state.line[r].step, state.line[r].slope
        last = state.line[r].tries >= LONGEST_LINE_SEARCH
        if not values[k] <= state.line[r].value + SUFFICIENT_DECREASE * step * slope:
            state.line[r].high = step
        # A search that keeps its decrease but never flattens ends with the decrease it has.
        elif last or _dot(gradients[k], state.d[r]) >= CURVATURE * slope:
            _accept(state, r, trial[k], values[k], gradients[k], tolerance, max_iterations)
            continue
        else:
            state.line[r].low = step
        state.line[r].active = not last
        state.line[r].step = _next_step(
            state.line[r].low, state.line[r].high, state.line[r].value, slope, values[k]
        )
    return evaluations


@njit
def _next_step(low: float, high: float, f: float, slope: float, beyond: float) -> float:
    """The next trial step: twice the last one until a bracket is found, then inside it.  At the
    minimum of a parabola while the bracket starts at zero and ends feasibly, else half way."""
    if high == np.inf:
        return 2.0 * low
    width = high - low
    if low == 0.0 and np.isfinite(beyond):
        parabola = -slope * high**2 / (2.0 * (beyond - f - slope * high))
        if np.isfinite(parabola):
            return min(max(parabola, SHORTEST_CUT * width), 0.5 * width)
    return low + 0.5 * width


@allocating_njit
def _accept(state, r, point, value, gradient, tolerance, max_iterations):
    """Move a start to its trial point and aim from there; end it where it has converged."""
    drop = state.line[r].value - value
    step, change, product = np.empty(point.size), np.empty(point.size), np.empty(point.size)
    for i in range(point.size):
        step[i] = state.line[r].step * state.d[r, i]
        change[i] = gradient[i] - state.g[r, i]
        state.x[r, i], state.g[r, i] = point[i], gradient[i]
    state.line[r].value = value
    _update(state.h[r], step, change, product)
    state.line[r].iterations += 1
    state.line[r].tries = 0
    _aim(state, r)
    limit = tolerance * abs(value)
    state.line[r].converged = -0.5 * state.line[r].slope <= limit and drop <= limit
    state.line[r].active = not (
        state.line[r].converged or state.line[r].iterations >= max_iterations
    )


@njit
def _aim(state: State, r: int) -> None:
    """Begin a line along the quasi-Newton direction, or steepest descent where that climbs."""
    h, g, d = state.h[r], state.g[r], state.d[r]
    _multiply(h, g, d)
    for i in range(g.size):
        d[i] = -d[i]
    state.line[r].slope = _dot(d, g)
    if not state.line[r].slope < 0.0:
        for i in range(g.size):
            for j in range(g.size):
                h[i, j] = 1.0 if i == j else 0.0
            d[i] = -g[i]
        state.line[r].slope = _dot(d, g)
    state.line[r].step, state.line[r].low, state.line[r].high = 1.0, 0.0, np.inf
    state.line[r].unaimed = False


@njit
def _update(h: Array, s: Array, y: Array, hy: Array) -> None:
    """Update an inverse Hessian by BFGS (Fletcher 1987), except where curvature is not positive.
    ``hy``: a buffer."""
    sy = _dot(s, y)
    if not sy > 1e-12 * np.sqrt(_dot(s, s) * _dot(y, y)):
        return
    _multiply(h, y, hy)
    weight = (1.0 + _dot(y, hy) / sy) / sy
    for i in range(len(s)):
        for j in range(len(s)):
            h[i, j] += weight * s[i] * s[j] - (hy[i] * s[j] + s[i] * hy[j]) / sy


# Sums in one order: the bits of a result must not depend on the processor's vectors.
@njit
def _dot(x: Array, y: Array) -> float:
    total = 0.0
    for i in range(len(x)):
        total += x[i] * y[i]
    return total


@njit
def _multiply(symmetric: Array, vector: Array, product: Array) -> None:
    for i in range(len(vector)):
        product[i] = 0.0
    for j in range(len(vector)):
        for i in range(len(vector)):
            product[i] += symmetric[j, i] * vector[j]


InverseHessians = Callable[[Array, Indices], Array]

# Trials after which the inverse Hessians are approximated anew, for all starts at once: they share
# the passes of that as well.  Not sooner: what a start has learnt of the land on its way leads it
# past more of the poor optima than the approximation does.
REFRESH = 80


@dataclass(frozen=True)
class Descent:
    """Where each start ended: points (M, n), values (M,), evaluations of value and gradient."""

    points: Array
    values: Array
    converged: Flags
    evaluations: int


def descend(
    evaluate: Callable[[Array, Indices], tuple[Array, Array]],
    starts: Array,
    inverse_hessians: InverseHessians,
    max_iterations: int,
    tolerance: float,
    refresh: bool = True,
    wait: float | None = None,
) -> Descent:
    """Minimise from each row of ``starts`` by BFGS, with a line search for corners too (Lewis &
    Overton 2013); points of infinite value only shorten the step.  ``evaluate`` and
    ``inverse_hessians`` get points and the starts ``rows`` they belong to, the latter on the way
    too with ``refresh``.  ``tolerance``: of the decreases promised and last made, relative to the
    value.  ``wait``: how much longer the last half may take, in times of the first half."""

    def tried(state: State, trials: int, few: int) -> tuple[int, int]:
        if not trials:
            state.line["value"], state.g[:] = evaluate(state.x, np.arange(len(starts)))
        made = evaluations = 0
        while made < trials:
            rows = state.line["active"].nonzero()[0]
            trial = trial_points(state, rows)
            values, gradients = evaluate(trial, rows)
            line_search = values, gradients, tolerance, max_iterations
            evaluations += advance(state, rows, trial, *line_search)
            made += 1
            if np.count_nonzero(state.line["active"]) <= few:
                break
        return made, evaluations

    return descend_by(tried, starts, inverse_hessians, refresh, wait)


def descend_by(
    advance: Callable[[State, int, int], tuple[int, int]],
    starts: Array,
    inverse_hessians: InverseHessians,
    refresh: bool = True,
    wait: float | None = None,
    first: Array | None = None,
) -> Descent:
    """Minimise as :func:`descend` does an objective that comes with the loop over its trials:
    ``advance(state, trials, few)`` lets active descents try points until so many trials are made,
    or no more than ``few`` are active.  No trials are values and gradients of the starts.
    ``first``: inverse Hessians of the starts, (M, n, n), where they are known."""
    state, count = state_at(starts.copy()), len(starts)
    advance(state, 0, 0)
    line, evaluations = state.line, count
    line["active"] = np.isfinite(line["value"])
    trials, latest = 0, np.inf
    while len(rows := line["active"].nonzero()[0]) and trials < latest:
        if wait is not None and latest == np.inf and 2 * len(rows) <= count:
            latest = (1.0 + wait) * trials
        if trials == 0 or (refresh and trials % REFRESH == 0):
            if first is None or trials:
                state.h[rows] = inverse_hessians(state.x[rows], rows)
            else:
                state.h[rows] = first[rows]
            line["unaimed"] = True
        refreshed = trials + REFRESH - trials % REFRESH
        most = max(math.ceil(min(refreshed, latest)) - trials, 1)
        few = count // 2 if wait is not None and latest == np.inf else 0
        made, spent = advance(state, most, few)
        trials, evaluations = trials + made, evaluations + spent
    return Descent(state.x, line["value"].copy(), line["converged"].copy(), evaluations)
