"""Algorithms of today, each as its own library offers it, on the same counted objective.

Every one runs until the objective ends it; the few that would end by themselves start again.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from evopem.fletcher_powell.libraries import library
from evopem.fletcher_powell.objective import Objective
from evopem.fletcher_powell.problem import descend_in_turn

Array = NDArray[np.float64]

# Random starts that share the passes of one descent.
STARTS_AT_ONCE = 10
# Half the side of the cube from which monotonic basin hopping draws its next start, in radians,
# and how many times in vain before it starts anew.
HOP = 2.0
HOPS_IN_VAIN = 100
# CMA-ES: the first step size, about a third of half the box's side.
CMA_FIRST_STEP = 1.0
# Differential evolution: the share of the budget that its last local search is left.
POLISH_SHARE = 0.1
# For libraries that take a number of iterations: more than any budget pays for.
ENDLESS = 10**9


def _uniform(objective: Objective, generator: np.random.Generator) -> Array:
    return generator.uniform(-np.pi, np.pi, objective.dimension)


def multi_start(objective: Objective, generator: np.random.Generator) -> None:
    """The hybrid's own BFGS from random points, one after another."""
    shape = (STARTS_AT_ONCE, objective.dimension)
    while True:
        descend_in_turn(objective, generator.uniform(-np.pi, np.pi, shape))


def scipy_multi_start(method: str) -> Callable[[Objective, np.random.Generator], None]:
    """SciPy's local minimiser of that name from random points, its settings as they come."""

    def run(objective: Objective, generator: np.random.Generator) -> None:
        from scipy.optimize import minimize

        while True:
            start = _uniform(objective, generator)
            minimize(objective.value_and_gradient, start, jac=True, method=method)

    return run


def basin_hopping(objective: Objective, generator: np.random.Generator) -> None:
    """SciPy's basin hopping with L-BFGS-B, its settings as they come."""
    from scipy.optimize import basinhopping

    basinhopping(
        objective.value_and_gradient,
        _uniform(objective, generator),
        niter=ENDLESS,
        minimizer_kwargs={"method": "L-BFGS-B", "jac": True},
        rng=generator,
    )


def monotonic_basin_hopping(objective: Objective, generator: np.random.Generator) -> None:
    """Monotonic basin hopping (Leary 2000) with the hybrid's own BFGS, restarted when stuck."""
    n = objective.dimension
    while True:
        best = descend_in_turn(objective, generator.uniform(-np.pi, np.pi, (1, n)))
        in_vain = 0
        while in_vain < HOPS_IN_VAIN:
            start = best.points + generator.uniform(-HOP, HOP, (1, n))
            found = descend_in_turn(objective, start)
            in_vain += 1
            if found.values[0] < best.values[0]:
                # A better digit of the same minimum is no progress.
                progress = found.values[0] < (1.0 - 1e-6) * best.values[0]
                in_vain = 0 if progress else in_vain
                best = found


def differential_evolution(objective: Objective, generator: np.random.Generator) -> None:
    """SciPy's differential evolution, its settings as they come, polished by L-BFGS-B."""
    from scipy.optimize import differential_evolution, minimize

    box = [(-np.pi, np.pi)] * objective.dimension
    while True:
        size = 15 * objective.dimension
        left = objective.budget - objective.evaluations
        result = differential_evolution(
            lambda columns: objective.values(np.ascontiguousarray(columns.T)),
            box,
            maxiter=max(1, int((1.0 - POLISH_SHARE) * left / size) - 1),
            vectorized=True,
            updating="deferred",
            polish=False,
            rng=generator,
        )
        minimize(objective.value_and_gradient, result.x, jac=True, method="L-BFGS-B")


def dual_annealing(objective: Objective, generator: np.random.Generator) -> None:
    """SciPy's dual annealing, its settings as they come, with this objective's gradients."""
    from scipy.optimize import dual_annealing

    box = [(-np.pi, np.pi)] * objective.dimension
    local = {"method": "L-BFGS-B", "jac": lambda point: objective.value_and_gradient(point)[1]}
    while True:
        dual_annealing(
            objective.value,
            box,
            maxiter=1000,
            maxfun=ENDLESS,
            minimizer_kwargs=local,
            rng=generator,
        )


def bipop_cma_es(objective: Objective, generator: np.random.Generator) -> None:
    """BIPOP-CMA-ES as the package cma offers it; it does not stop before the last digits."""
    cma = library("cma")
    options = {
        "tolfun": 0,
        "tolfunhist": 0,
        "tolx": 0,
        "maxfevals": ENDLESS,
        "verbose": -9,
        "verb_log": 0,
        # 0 would let the package take the time for its seed.
        "seed": int(generator.integers(1, 2**31)),
    }
    while True:
        cma.fmin2(
            None,
            lambda: _uniform(objective, generator),
            CMA_FIRST_STEP,
            options,
            restarts=ENDLESS,
            bipop=True,
            parallel_objective=lambda points: objective.values(np.array(points)).tolist(),
        )
