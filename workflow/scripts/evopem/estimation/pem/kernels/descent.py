"""Descents of a population by lockstep BFGS, their trials without Python in between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.bfgs import advance, state_at, trial_points
from evopem.estimation.pem.kernels.cache import cached_njit, inlined, njit
from evopem.estimation.pem.kernels.gradient import loss_and_gradient
from evopem.estimation.pem.kernels.record import (
    Objective,
    Record,
    Workspace,
    all_finite,
    load_points,
    marked_rows,
    squared_state,
)
from evopem.estimation.pem.kernels.simd import LANES, constant, store
from evopem.estimation.pem.kernels.single_model import loss_and_gradient_of_one
from evopem.estimation.pem.kernels.stability import barrier

Array = NDArray[np.float64]


@inlined
def values_and_gradients(record, objective, workspace, points, starts, smoothing, barriers):
    """Smoothed objective of each row with a barrier added, and its gradient.

    The absolute value is smoothed, ``sqrt(e**2 + smoothing**2)``.  The barrier is that of
    :func:`.stability.stability_barriers`, of A and of C, times ``barriers``.  Smoothing and weight
    of the barrier of a row are those of the start that it belongs to.  Infeasible rows are inf and
    0.
    """
    found = np.empty(points.shape[0])
    gradients = np.empty(points.shape)
    radius = objective.max_root_radius
    a, noise = record.na, record.na + record.nb
    c = noise + record.nc
    of_roots = np.empty(found.size)
    order = max(record.na, record.nc)
    work = np.empty((order + 1, order))
    for r in range(found.size):
        found[r] = np.inf
        for i in range(points.shape[1]):
            gradients[r, i] = 0.0
        of_roots[r] = barrier(points[r, :a], radius, work, gradients[r, :a])
        of_roots[r] += barrier(points[r, noise:c], radius, work, gradients[r, noise:c])
    feasible = marked_rows(of_roots < np.inf)
    i = 0
    while i < feasible.size:
        rows = feasible[i : i + LANES]
        i += rows.size
        if rows.size == 1:
            workspace.total[0, 0] = loss_and_gradient_of_one(
                record, workspace, objective.absolute, points[rows[0]], smoothing[starts[rows[0]]]
            )
        else:
            load_points(record, points, rows, workspace.parameters)
            store(workspace.smoothing, 0, constant(1.0))
            for lane, r in enumerate(rows):
                workspace.smoothing[0, lane] = smoothing[starts[r]]
            store(workspace.total, 0, loss_and_gradient(record, workspace, objective.absolute))
        for lane, r in enumerate(rows):
            weight = barriers[starts[r]]
            for k in range(points.shape[1]):
                gradients[r, k] *= weight
            _unload_gradient(record, objective, workspace.gradient, lane, points[r], gradients[r])
            value = objective.factor * workspace.total[0, lane] + weight * of_roots[r]
            value += objective.state_weight * squared_state(record, points[r])
            if np.isfinite(value) and all_finite(gradients[r]):
                found[r] = value
    for r in range(found.size):
        if not np.isfinite(found[r]):
            for i in range(points.shape[1]):
                gradients[r, i] = 0.0
    return found, gradients


@njit
def _unload_gradient(record, objective, table, lane, point, gradient):
    """Add one lane's gradient, with respect to the signed parameters, to a row of gradients."""
    factor, state = objective.factor, record.na + record.nb + record.nc
    for i in range(record.na):
        gradient[i] += factor * table[i, lane]
    for i in range(record.na, state):
        gradient[i] -= factor * table[i, lane]
    for k in range(record.nc):
        gradient[state + k] += factor * table[record.na + record.nb + record.rows_c + k, lane]
        gradient[state + k] += 2.0 * objective.state_weight * point[state + k]


@cached_njit
def advance_descents(
    record,
    objective,
    workspace,
    state,
    smoothing,
    barriers,
    tolerance,
    max_iterations,
    trials,
    few,
):
    """Trials of all descents, until so many are made or no more than ``few`` descents go on.

    No trials are the values and gradients of the starts.  The objective is that of
    :func:`.gradient.values_and_gradients`, the step that of :func:`.bfgs.advance`; both are here in
    one function because each function that Python calls is compiled with all that it calls.

    Returns
    -------
    trials and evaluations that were made
    """
    made = evaluations = 0
    while True:
        rows = marked_rows(state.line["active"])
        trial = trial_points(state, rows) if trials else state.x
        values, gradients = values_and_gradients(
            record, objective, workspace, trial, rows, smoothing, barriers
        )
        if not trials:
            for r in rows:
                state.line[r].value = values[r]
                for i in range(trial.shape[1]):
                    state.g[r, i] = gradients[r, i]
            return made, evaluations
        evaluations += advance(state, rows, trial, values, gradients, tolerance, max_iterations)
        made += 1
        going_on = 0
        for r in rows:
            going_on += state.line[r].active
        if made == trials or going_on <= few:
            return made, evaluations


def values_and_gradients_at(
    record: Record,
    objective: Objective,
    workspace: Workspace,
    points: Array,
    smoothing: Array,
    barriers: Array,
) -> tuple[Array, Array]:
    """Smoothed objective of each row, (M,), and its gradient, (M, n)."""
    state = state_at(points)
    advance_descents(record, objective, workspace, state, smoothing, barriers, 0.0, 0, 0, 0)
    return state.line["value"].copy(), state.g
