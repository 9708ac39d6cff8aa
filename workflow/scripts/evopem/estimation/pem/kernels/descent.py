"""Descents of a population by lockstep BFGS, their trials without Python in between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.bfgs import advance, state_at, trial_points
from evopem.estimation.pem.kernels.cache import cached_njit
from evopem.estimation.pem.kernels.gradient import values_and_gradients
from evopem.estimation.pem.kernels.record import Objective, Record, Workspace, marked_rows

Array = NDArray[np.float64]


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
