"""Descents from given starts, the best of them refined: the search of small numbers of starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.estimation.search.problem import (
    SearchDiagnostics,
    SearchResult,
    converged_values,
    count_confirming,
    count_distinct,
    same_optimum,
)
from evopem.estimation.search.staged_descent import (
    DESCENT_STAGES,
    PredictionErrors,
    polish,
    staged_descent,
)

Array = NDArray[np.float64]

# Relative distance from the lowest value within which a descent is refined, and the most of them.
NEAR, REFINED = 1e-3, 8


def multistart(errors: PredictionErrors, starts: Array, largest_value: float) -> SearchResult:
    """Descend from every start, refine the lowest, and count how many agree.

    ``starts`` (M, n): those without a finite value are left out.  ``restart_minima`` has one value
    for each start; descents count as restarts.  InputError when no start has a finite value.
    """
    values = errors.values(starts)
    evaluations = len(starts)
    starts = starts[np.isfinite(values)]
    if not len(starts):
        raise InputError(
            "constraints",
            "no model that was tried meets them",
            "relax the constraints, or raise the orders",
        )
    descents = staged_descent(errors, starts, DESCENT_STAGES, largest_value)
    evaluations += descents.evaluations
    order = np.argsort(descents.values, kind="stable")
    lowest = descents.values[order[0]]
    near = [row for row in order if same_optimum(descents.values[row], lowest, NEAR)][:REFINED]
    refined = polish(errors, descents.points[near], largest_value)
    evaluations += refined.evaluations
    minima = descents.values.copy()
    minima[near] = refined.values
    best = int(np.argmin(refined.values))
    value = float(refined.values[best])
    return SearchResult(
        point=refined.points[best],
        value=value,
        diagnostics=SearchDiagnostics(
            evaluations=evaluations,
            generations=0,
            restart_minima=tuple(float(minimum) for minimum in minima),
            n_confirming=count_confirming(tuple(minima.tolist()), value),
            n_local_optima=count_distinct(converged_values(descents)),
            n_multistart=0,
            undiscovered_probability=1.0,
            convergence=((evaluations, value),),
        ),
    )
