"""Baselines: established global search algorithms on the same counted objective.

Each runs until the objective raises ``RunOver``; one that ends earlier is started again.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.kernels.bfgs import Descent
from fletcher_powell.objective import Objective
from fletcher_powell.packages import import_package
from fletcher_powell.problem import COARSE, STEP, descend_in_turn, least_squares_in_turn

Array = NDArray[np.float64]

# Random points whose descents are computed together.
STARTS_AT_ONCE = 10
# Monotonic basin hopping: steps without progress after which it starts again from a random point.
STEPS_WITHOUT_PROGRESS = 100
# CMA-ES: first step size in radians, about a third of half the side of the box.
CMA_FIRST_STEP = 1.0
# Differential evolution: share of the budget left to the final local search.
POLISH_SHARE = 0.1
# Number of iterations that no budget allows, for libraries that ask for one.
ENDLESS = 10**9


def _uniform(objective: Objective, generator: np.random.Generator) -> Array:
    return generator.uniform(-np.pi, np.pi, objective.dimension)


def multi_start(objective: Objective, generator: np.random.Generator) -> None:
    """Multi-start with the hybrid's BFGS."""
    shape = (STARTS_AT_ONCE, objective.dimension)
    while True:
        descend_in_turn(objective, generator.uniform(-np.pi, np.pi, shape))


def scipy_multi_start(method: str) -> Callable[[Objective, np.random.Generator], None]:
    """Multi-start with a local method of SciPy at its default settings."""

    def search(objective: Objective, generator: np.random.Generator) -> None:
        from scipy.optimize import minimize

        while True:
            start = _uniform(objective, generator)
            minimize(objective.value_and_gradient, start, jac=True, method=method)

    return search


def basin_hopping(objective: Objective, generator: np.random.Generator) -> None:
    """SciPy's basin hopping with L-BFGS-B, default settings."""
    from scipy.optimize import basinhopping

    basinhopping(
        objective.value_and_gradient,
        _uniform(objective, generator),
        niter=ENDLESS,
        minimizer_kwargs={"method": "L-BFGS-B", "jac": True},
        rng=generator,
    )


def scipy_least_squares(objective: Objective, generator: np.random.Generator) -> None:
    """Multi-start with SciPy's least_squares at its default settings."""
    from scipy.optimize import least_squares

    while True:
        least_squares(objective.residuals, _uniform(objective, generator), jac=objective.jacobian)


def monotonic_basin_hopping(objective: Objective, generator: np.random.Generator) -> None:
    """Monotonic basin hopping (Leary 2000) with the hybrid's BFGS, with restarts."""
    _hop(objective, generator, descend_in_turn)


def least_squares_hopping(objective: Objective, generator: np.random.Generator) -> None:
    """The same with the descents of the default search."""
    _hop(objective, generator, partial(least_squares_in_turn, tolerance=COARSE))


def _hop(
    objective: Objective,
    generator: np.random.Generator,
    descend: Callable[[Objective, Array], Descent],
) -> None:
    n = objective.dimension
    while True:
        best = descend(objective, generator.uniform(-np.pi, np.pi, (1, n)))
        without_progress = 0
        while without_progress < STEPS_WITHOUT_PROGRESS:
            start = best.points + generator.uniform(-STEP, STEP, (1, n))
            found = descend(objective, start)
            without_progress += 1
            if found.values[0] < best.values[0]:
                # A better digit of the same minimum is no progress.
                if found.values[0] < (1.0 - 1e-6) * best.values[0]:
                    without_progress = 0
                best = found


def differential_evolution(objective: Objective, generator: np.random.Generator) -> None:
    """SciPy's differential evolution, default settings, followed by L-BFGS-B."""
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
    """SciPy's dual annealing, default settings, with gradients in its local search."""
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
    """BIPOP-CMA-ES of the package cma, without tolerances of f and x."""
    cma = import_package("cma")
    options = {
        "tolfun": 0,
        "tolfunhist": 0,
        "tolx": 0,
        "maxfevals": ENDLESS,
        "verbose": -9,
        "verb_log": 0,
        # A seed of 0 would make the package take its seed from the clock.
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
