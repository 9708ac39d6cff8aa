"""BFGS for many starts at once, in lockstep, so that they share the passes of the objective."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evopem.arrays import Array, Flags, Indices
from evopem.estimation.pem.kernels.bfgs import State, advance, state_at, trial_points

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
            every = np.arange(len(starts))
            state.line["value"], state.g[:] = evaluate(state.x, every)
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
) -> Descent:
    """Minimise as :func:`descend` does an objective that comes with the loop over its trials:
    ``advance(state, trials, few)`` lets active descents try points until so many trials are made,
    or no more than ``few`` are active.  No trials are values and gradients of the starts."""
    state, count = state_at(starts.copy()), len(starts)
    advance(state, 0, 0)
    line, evaluations = state.line, count
    line["active"] = np.isfinite(line["value"])
    trials, latest = 0, np.inf
    while len(rows := line["active"].nonzero()[0]) and trials < latest:
        if wait is not None and latest == np.inf and 2 * len(rows) <= count:
            latest = (1.0 + wait) * trials
        if trials == 0 or (refresh and trials % REFRESH == 0):
            state.h[rows] = inverse_hessians(state.x[rows], rows)
            line["unaimed"] = True
        refreshed = trials + REFRESH - trials % REFRESH
        most = max(math.ceil(min(refreshed, latest)) - trials, 1)
        few = count // 2 if wait is not None and latest == np.inf else 0
        made, spent = advance(state, most, few)
        trials, evaluations = trials + made, evaluations + spent
    return Descent(state.x, line["value"].copy(), line["converged"].copy(), evaluations)
