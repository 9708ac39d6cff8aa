"""A multistart check of an optimum: descents from random points, with a stopping rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.search.problem import Problem, converged_values, undiscovered

Array = NDArray[np.float64]

# Random points of the first batch; each further batch doubles their number.
FIRST_BATCH = 32
# Undiscovered probability at which the check ends, and the one at which it gives up: there are too
# many local optima to find them all.
SUFFICIENT_PROBABILITY, HOPELESS_PROBABILITY = 0.003, 0.2


@dataclass(frozen=True)
class MultistartCheck:
    """The best optimum of a multistart, the values of all, and the probability of a further one."""

    point: Array
    value: float
    optima: tuple[float, ...]
    n_multistart: int
    undiscovered_probability: float
    evaluations: int


def multistart_check(
    problem: Problem, max_evaluations: int, generator: np.random.Generator
) -> MultistartCheck:
    """Descend from random points until a further local optimum is improbable.

    The probability is :func:`.problem.undiscovered`.

    Parameters
    ----------
    problem : Problem
    max_evaluations : int
        Evaluations after which no further batch starts, beyond ``problem.min_multistart`` points.
    generator : numpy.random.Generator
    """
    optima: list[float] = []
    best_point, best_value = np.empty(0), np.inf
    points = evaluations = 0
    probability = 1.0
    while points < problem.min_multistart or (
        probability > SUFFICIENT_PROBABILITY and evaluations < max_evaluations
    ):
        batch = max(points, FIRST_BATCH)
        descents = problem.descend(problem.random(batch, generator))
        points += batch
        evaluations += descents.evaluations
        optima.extend(converged_values(descents))
        best = int(np.argmin(descents.values))
        if descents.values[best] <= best_value:
            best_point, best_value = descents.points[best], float(descents.values[best])
        probability = undiscovered(optima)
        if probability > HOPELESS_PROBABILITY:
            break
    polished = problem.polish(best_point[None, :])
    return MultistartCheck(
        point=polished.points[0],
        value=float(polished.values[0]),
        optima=tuple(optima),
        n_multistart=points,
        undiscovered_probability=probability,
        evaluations=evaluations + polished.evaluations,
    )
