"""BFGS for many starts at once, in lockstep, so that they share the passes of the objective."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.bfgs import State, advance, state_at, trial_points

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Evaluate = Callable[[Array, Rows], tuple[Array, Array]]
InverseHessians = Callable[[Array, Rows], Array]
Advance = Callable[[State, int, int], tuple[int, int]]

# Trials after which the inverse Hessians are approximated anew, for all starts at once: they share
# the passes of that as well.  Not sooner: what a start has learnt of the land on its way leads it
# past more of the poor optima than the approximation does.
REFRESH = 80


@dataclass(frozen=True)
class Descent:
    """Where each start ended: points (M, n), values (M,), evaluations of value and gradient."""

    points: Array
    values: Array
    converged: NDArray[np.bool_]
    evaluations: int


def descend(
    evaluate: Evaluate,
    starts: Array,
    inverse_hessians: InverseHessians,
    max_iterations: int,
    tolerance: float,
    refresh: bool = True,
    wait: float | None = None,
) -> Descent:
    """Minimise from each row of ``starts`` by BFGS with a weak Wolfe line search.

    The line search brackets and bisects as Lewis & Overton (2013) do for objectives with corners,
    so it serves the absolute objective as well as the quadratic one; points of infinite value
    (outside the stability region) only shorten the step.

    ``evaluate``: ``evaluate(points, rows)``: values (m,) and gradients (m, n) at the (m, n) points,
    which belong to the starts ``rows``; infinite values allowed.  ``starts`` (M, n).
    ``inverse_hessians``: ``inverse_hessians(points, rows)``: first approximations of the inverse
    Hessian, (m, n, n).  ``max_iterations``: accepted steps a start may take.  ``tolerance``: A
    start has converged once the decrease its quadratic model promises, and the decrease it last
    made, are below this fraction of its value.  ``refresh``: whether ``inverse_hessians`` knows
    more on the way than at the start, and is asked again.  ``wait``: how much longer the rest may
    take once half of the starts have ended, in what those took; by default all go on to their ends.
    """

    def tried(state: State, trials: int, few: int) -> tuple[int, int]:
        if not trials:
            every = np.arange(len(starts))
            state.line["value"], state.g[:] = evaluate(state.x, every)
        made = evaluations = 0
        while made < trials:
            rows = state.line["active"].nonzero()[0]
            trial = trial_points(state, rows)
            values, gradients = evaluate(trial, rows)
            found = values, gradients, tolerance, max_iterations
            evaluations += advance(state, rows, trial, *found)
            made += 1
            if np.count_nonzero(state.line["active"]) <= few:
                break
        return made, evaluations

    return descend_by(tried, starts, inverse_hessians, refresh, wait)


def descend_by(
    advance: Advance,
    starts: Array,
    inverse_hessians: InverseHessians,
    refresh: bool = True,
    wait: float | None = None,
) -> Descent:
    """Minimise as :func:`descend` does an objective that comes with the loop over its trials.

    ``advance``: ``advance(state, trials, few)`` lets the active descents of a :class:`State` try
    points, until they have made so many trials or no more than ``few`` are active.  No trials are
    the values and gradients of the starts.  Returns the trials and the evaluations that were made.
    """
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
