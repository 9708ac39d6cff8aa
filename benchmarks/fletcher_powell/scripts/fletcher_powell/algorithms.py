"""Every algorithm of the comparison, by name, with its settings in words.

The chapter's four algorithms come first, then the hybrid with each choice of the offspring that
the chapter rejected, the default search of the identification, and the baselines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from evopem.config.settings import Refine, SearchSettings
from evopem.estimation.search.global_search import global_search
from evopem.estimation.search.memetic import memetic_search
from fletcher_powell import baselines, evolution
from fletcher_powell.objective import Objective
from fletcher_powell.problem import STEP, FletcherPowellProblem, LeastSquaresProblem

Search = Callable[[Objective, np.random.Generator], None]


@dataclass(frozen=True)
class Algorithm:
    """One algorithm.

    Attributes
    ----------
    label : str
        Its name in tables.
    settings : str
        Its settings, and which of them are assumptions.
    search : callable
        ``search(objective, generator)`` runs until the objective raises ``RunOver``.
    """

    label: str
    settings: str
    search: Search


# The default settings of the identification, except that the budget alone ends a run.
HYBRID = SearchSettings(evaluations=baselines.ENDLESS)


def _hybrid(refine: Refine, lambda_: int = HYBRID.lambda_, nu: int = HYBRID.nu) -> Search:
    """The product's memetic search; `refine` says which of the offspring BFGS refines."""
    settings = replace(HYBRID, refine=refine, lambda_=lambda_, nu=nu)

    def search(objective: Objective, generator: np.random.Generator) -> None:
        memetic_search(
            FletcherPowellProblem(objective),
            settings,
            generator,
            agreeing_restarts=baselines.ENDLESS,
        )

    return search


def _default(objective: Objective, generator: np.random.Generator) -> None:
    """The search with which identification begins, on the residuals."""
    problem = LeastSquaresProblem(objective)
    while True:
        global_search(problem, HYBRID, generator)


def _on_values(algorithm: Callable[..., None]) -> Search:
    """A search that takes values alone, started in the box."""

    def search(objective: Objective, generator: np.random.Generator) -> None:
        algorithm(objective.values, evolution.Box(objective.dimension), generator)

    return search


_HYBRID_SETTINGS = (
    f"({HYBRID.mu}+{HYBRID.lambda_}), ν = {HYBRID.nu}: the defaults of the identification; "
    "discrete recombination of two parents; BFGS to convergence (at most 200 or 10 n iterations; "
    "with finite differences, until 30 evaluations bring less than 0.1 %); an independent "
    "population once one has converged; no bounds, end points wrapped into the box"
)
ALGORITHMS: dict[str, Algorithm] = {
    "hybrid": Algorithm(
        "Hybrid", f"BFGS refines the worst offspring. {_HYBRID_SETTINGS}", _hybrid("worst")
    ),
    "es": Algorithm(
        "(15+100)-ES",
        "n step sizes, first 3.0; coordinates from one of two parents, step sizes their mean; "
        "τ' = 1/√(2n), τ = 1/√(2√n). Assumed: recombination and first step size",
        _on_values(evolution.evolution_strategy),
    ),
    "ep": Algorithm(
        "meta-EP (6.0, 10, 100)",
        "variance update ζ = 6.0, 10 opponents, population 100; first variances uniform in "
        "[0, 25]. Assumed: that the chapter's 60 means 6.0, and the first variances",
        _on_values(evolution.evolutionary_programming),
    ),
    "ga": Algorithm(
        "GA (30, 0.001, 5, 100)",
        "30 bits a variable, Gray code, mutation rate 0.001, scaling window 5, population 100, "
        "two-point crossover at rate 0.6, proportional selection by stochastic universal "
        "sampling, no elitism. Assumed: that 5 is the scaling window; code, crossover and "
        "selection",
        _on_values(evolution.genetic_algorithm),
    ),
    "hybrid-all": Algorithm(
        "Hybrid, all", f"BFGS refines all offspring. {_HYBRID_SETTINGS}", _hybrid("all")
    ),
    "hybrid-best": Algorithm(
        "Hybrid, best", f"BFGS refines the best offspring. {_HYBRID_SETTINGS}", _hybrid("best")
    ),
    "hybrid-random": Algorithm(
        "Hybrid, random",
        f"BFGS refines offspring drawn at random. {_HYBRID_SETTINGS}",
        _hybrid("random"),
    ),
    "hybrid-small": Algorithm(
        "Hybrid (15+30), ν = 5",
        "as the hybrid with 30 offspring, 5 of them refined by BFGS",
        _hybrid("worst", lambda_=30, nu=5),
    ),
    "default": Algorithm(
        "Default search",
        "the search of the identification (evopem.estimation.search.global_search): "
        "Levenberg-Marquardt descents from random points, hops uniform in "
        f"±{STEP:g} from the lowest point, then restarts; a search that ends is begun again. It "
        "knows the residuals: they count as one value, their derivatives as one gradient",
        _default,
    ),
    "multi-start": Algorithm(
        "Multi-start BFGS", "the hybrid's BFGS from random points", baselines.multi_start
    ),
    "multi-start-scipy": Algorithm(
        "Multi-start BFGS (SciPy)",
        "scipy.optimize.minimize, default settings, from random points",
        baselines.scipy_multi_start("BFGS"),
    ),
    "multi-start-lbfgsb": Algorithm(
        "Multi-start L-BFGS-B (SciPy)",
        "scipy.optimize.minimize, default settings, without bounds, from random points",
        baselines.scipy_multi_start("L-BFGS-B"),
    ),
    "multi-start-least-squares": Algorithm(
        "Multi-start least_squares (SciPy)",
        "scipy.optimize.least_squares, default settings, from random points; it knows the "
        "residuals as the default search does",
        baselines.scipy_least_squares,
    ),
    "basin-hopping": Algorithm(
        "Basin hopping (SciPy)",
        "default settings (step 0.5, adapted; temperature 1) with L-BFGS-B",
        baselines.basin_hopping,
    ),
    "monotonic-basin-hopping": Algorithm(
        "Monotonic basin hopping",
        f"the hybrid's BFGS; steps uniform in ±{STEP:g}, chosen as the best of 0.5, 1, "
        f"1.5 and 2; a new random point after {baselines.STEPS_WITHOUT_PROGRESS} steps without "
        "progress",
        baselines.monotonic_basin_hopping,
    ),
    "least-squares-hopping": Algorithm(
        "Monotonic basin hopping, least squares",
        "the same with the Levenberg-Marquardt descents of the default search",
        baselines.least_squares_hopping,
    ),
    "cma-es": Algorithm(
        "BIPOP-CMA-ES (cma)",
        f"default settings, first step size {baselines.CMA_FIRST_STEP:g}, starting points uniform "
        "in the box, tolerances of f and x set to 0 so that a run continues to the last digits",
        baselines.bipop_cma_es,
    ),
    "differential-evolution": Algorithm(
        "Differential evolution (SciPy)",
        "default settings (best1bin, 15 n individuals) for nine tenths of the budget, then "
        "L-BFGS-B",
        baselines.differential_evolution,
    ),
    "dual-annealing": Algorithm(
        "Dual annealing (SciPy)",
        "default settings, with L-BFGS-B as local search",
        baselines.dual_annealing,
    ),
}
