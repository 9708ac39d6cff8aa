"""Passes over the record: residuals, values, gradients, and descents by lockstep BFGS."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.bfgs import LINE, State, advance, trial_points
from evopem.estimation.pem.kernels.cache import cached_njit
from evopem.estimation.pem.kernels.gradient import GRADIENTS, RESIDUALS, VALUES, pass_over
from evopem.estimation.pem.kernels.record import (
    ANY_OBJECTIVE,
    Objective,
    Record,
    Workspace,
    marked_rows,
)

Array = NDArray[np.float64]


@cached_njit
def _run(
    record,
    objective,
    workspace,
    task,
    state,
    smoothing,
    barriers,
    tolerance,
    max_iterations,
    trials,
    few,
):
    """Trials of all descents, until so many are made or no more than ``few`` descents go on.

    No trials are a pass over the points of the state.  One function for both, compiled and loaded
    once with all that it calls: the objective is that of :func:`.gradient.pass_over`, the step
    that of :func:`.bfgs.advance`.  Returns trials, evaluations and what the last pass gave.
    """
    made = evaluations = 0
    while True:
        rows = marked_rows(state.line["active"])
        trial = trial_points(state, rows) if trials else state.x
        values, gradients = pass_over(
            record, objective, workspace, task, trial, smoothing[rows], barriers[rows]
        )
        if not trials:
            return made, evaluations, values, gradients
        evaluations += advance(state, rows, trial, values, gradients, tolerance, max_iterations)
        made += 1
        going_on = 0
        for r in rows:
            going_on += state.line[r].active
        if made == trials or going_on <= few:
            return made, evaluations, values, gradients


def _passed(
    record: Record,
    objective: Objective,
    workspace: Workspace,
    task: int,
    points: Array,
    weights: tuple[Array, Array],
) -> tuple[Array, Array]:
    """One pass over the points."""
    line = np.zeros(len(points), LINE)
    line["active"] = True
    none = np.empty((0, 0))
    state = State(points, none, np.empty((0, 0, 0)), none, line)
    found = _run(record, objective, workspace, task, state, *weights, 0.0, 0, 0, 0)
    return found[2], found[3]


def residuals(record: Record, workspace: Workspace, point: Array) -> Array:
    """Residuals of one point from the first on, as many as the record has."""
    weights, samples = (np.zeros(1), np.zeros(1)), record.loss_stop - record.residual_start
    _passed(record, ANY_OBJECTIVE, workspace, RESIDUALS, point[None, :], weights)
    return workspace.e[record.history : record.history + samples, 0].copy()


def values(record: Record, objective: Objective, workspace: Workspace, points: Array) -> Array:
    """Objective of each row of a population, (M,); infeasible rows are inf."""
    none = np.zeros(len(points))
    return _passed(record, objective, workspace, VALUES, points, (none, none))[0]


def values_and_gradients(
    record: Record,
    objective: Objective,
    workspace: Workspace,
    points: Array,
    smoothing: Array,
    barriers: Array,
) -> tuple[Array, Array]:
    """Smoothed objective of each row with a barrier added, and its gradient.

    The absolute value is smoothed, ``sqrt(e**2 + smoothing**2)``.  The barriers
    (:func:`.stability.stability_barriers`) of A, C, D and F_i, times ``barriers``, are added.
    Infeasible rows are inf and 0.
    """
    return _passed(record, objective, workspace, GRADIENTS, points, (smoothing, barriers))


def advance_descents(
    record: Record,
    objective: Objective,
    workspace: Workspace,
    state: State,
    smoothing: Array,
    barriers: Array,
    tolerance: float,
    max_iterations: int,
    trials: int,
    few: int,
) -> tuple[int, int]:
    """Trials of all descents, until so many are made or no more than ``few`` descents go on.

    No trials are the values and gradients of the starts, whose smoothing and barriers these are.
    Returns the trials and evaluations that were made.
    """
    weights = (smoothing, barriers)
    if not trials:
        found = _passed(record, objective, workspace, GRADIENTS, state.x, weights)
        state.line["value"], state.g[:] = found
        return 0, 0
    made, evaluations, _, _ = _run(
        *(record, objective, workspace, GRADIENTS, state, *weights),
        *(tolerance, max_iterations, trials, few),
    )
    return made, evaluations
