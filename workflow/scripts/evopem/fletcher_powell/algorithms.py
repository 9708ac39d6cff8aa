"""Every algorithm of the comparison, by name, with all of its settings in words.

The chapter's algorithms come first, then the hybrid's three rejected choices, then those of today.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evopem.estimation.search.memetic import SearchSettings, hybrid_search
from evopem.fletcher_powell import evolution, peers
from evopem.fletcher_powell.objective import Objective
from evopem.fletcher_powell.problem import FletcherPowellProblem

Run = Callable[[Objective, np.random.Generator], None]


@dataclass(frozen=True)
class Algorithm:
    """One algorithm.

    Attributes
    ----------
    label : str
        Its name in tables.
    settings : str
        Every setting, and which of them are guesses.
    run : callable
        ``run(objective, generator)`` until the objective raises ``RunOver``.
    """

    label: str
    settings: str
    run: Run


# The identification's own settings; only its early stop is set out of reach, so that the budget
# alone ends a run.
HYBRID = SearchSettings(evaluations=peers.ENDLESS, agreement=peers.ENDLESS)


def _hybrid(
    mutate: str, mu: int = HYBRID.mu, lambda_: int = HYBRID.lambda_, nu: int = HYBRID.nu
) -> Run:
    settings = SearchSettings(mu, lambda_, nu, mutate, HYBRID.evaluations, HYBRID.agreement)

    def run(objective: Objective, generator: np.random.Generator) -> None:
        hybrid_search(FletcherPowellProblem(objective), settings, generator)

    return run


def _on_values(algorithm: Callable[..., None]) -> Run:
    def run(objective: Objective, generator: np.random.Generator) -> None:
        algorithm(objective.values, evolution.Box(objective.dimension), generator)

    return run


_HYBRID_SETTINGS = (
    f"({HYBRID.mu}+{HYBRID.lambda_}), ν = {HYBRID.nu}: the identification's defaults; discrete "
    "recombination of two parents, BFGS to convergence (at most 200 or 10 n steps; by "
    "differences, until 30 evaluations bring less than 0.1 %), a new "
    "population when one has collapsed; unbounded, end points wrapped into the box"
)
ALGORITHMS: dict[str, Algorithm] = {
    "hybrid": Algorithm("Hybrid", f"BFGS mutates the worst. {_HYBRID_SETTINGS}", _hybrid("worst")),
    "es": Algorithm(
        "(15+100)-ES",
        "n step sizes, first 3.0; coordinates from one of two parents, step sizes their mean; "
        "τ' = 1/√(2n), τ = 1/√(2√n). Guessed: recombination and first step size",
        _on_values(evolution.evolution_strategy),
    ),
    "ep": Algorithm(
        "meta-EP (6.0, 10, 100)",
        "variance update ζ = 6.0, 10 opponents, population 100; first variances uniform in "
        "[0, 25]. Guessed: that 60 is 6.0, and the first variances",
        _on_values(evolution.evolutionary_programming),
    ),
    "ga": Algorithm(
        "GA (30, 0.001, 5, 100)",
        "30 bits a variable, Gray code, mutation 0.001, scaling window 5, population 100, "
        "two-point crossover at rate 0.6, proportional selection by universal sampling, no "
        "elitism. Guessed: that 5 is the scaling window, code, crossover and selection",
        _on_values(evolution.genetic_algorithm),
    ),
    "hybrid-all": Algorithm(
        "Hybrid, all", f"BFGS mutates everyone. {_HYBRID_SETTINGS}", _hybrid("all")
    ),
    "hybrid-best": Algorithm(
        "Hybrid, best", f"BFGS mutates the best. {_HYBRID_SETTINGS}", _hybrid("best")
    ),
    "hybrid-random": Algorithm(
        "Hybrid, random", f"BFGS mutates random ones. {_HYBRID_SETTINGS}", _hybrid("random")
    ),
    "hybrid-small": Algorithm(
        "Hybrid (15+30), ν = 5",
        "as the hybrid with 30 offspring, 5 of them mutated by BFGS",
        _hybrid("worst", lambda_=30, nu=5),
    ),
    "multi-start": Algorithm(
        "Multi-start BFGS", "the hybrid's own BFGS from random points", peers.multi_start
    ),
    "multi-start-scipy": Algorithm(
        "Multi-start BFGS (SciPy)",
        "scipy.optimize.minimize, default settings, from random points",
        peers.scipy_multi_start("BFGS"),
    ),
    "multi-start-lbfgsb": Algorithm(
        "Multi-start L-BFGS-B (SciPy)",
        "scipy.optimize.minimize, default settings, without bounds, from random points",
        peers.scipy_multi_start("L-BFGS-B"),
    ),
    "basin-hopping": Algorithm(
        "Basin hopping (SciPy)",
        "default settings (step 0.5, adapted; temperature 1) with L-BFGS-B",
        peers.basin_hopping,
    ),
    "monotonic-basin-hopping": Algorithm(
        "Monotonic basin hopping",
        f"the hybrid's own BFGS, hops uniform in ±{peers.HOP:g}, a new start after "
        f"{peers.HOPS_IN_VAIN} in vain; the hop was chosen as the best of 0.5, 1, 1.5 and 2",
        peers.monotonic_basin_hopping,
    ),
    "cma-es": Algorithm(
        "BIPOP-CMA-ES (cma)",
        f"default settings, first step size {peers.CMA_FIRST_STEP:g}, starts uniform in the box, "
        "tolerances of f and x at 0 so that it does not stop before the last digits",
        peers.bipop_cma_es,
    ),
    "differential-evolution": Algorithm(
        "Differential evolution (SciPy)",
        "default settings (best1bin, 15 n individuals) for nine tenths of the budget, then "
        "L-BFGS-B",
        peers.differential_evolution,
    ),
    "dual-annealing": Algorithm(
        "Dual annealing (SciPy)", "default settings, L-BFGS-B inside", peers.dual_annealing
    ),
}
