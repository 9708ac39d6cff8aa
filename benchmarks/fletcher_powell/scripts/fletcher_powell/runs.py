"""Runs of one algorithm on one instance, each with random numbers of its own seed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from fletcher_powell.algorithms import ALGORITHMS
from fletcher_powell.experiments import UNTIL_TARGET, Case
from fletcher_powell.function import instance
from fletcher_powell.objective import TARGET, Objective, RunOver

# Points of a convergence curve, evenly spaced in the logarithm of the evaluations.
CURVE_POINTS = 60


@dataclass(frozen=True)
class Run:
    """Result of one run.

    Attributes
    ----------
    study, algorithm, instance : str
    dimension : int
    gradient : {"differences", "analytic"}
        How gradients were computed and counted.
    run : int
        Number of the run, from 1.
    budget : int
    evaluations : int
        Evaluations made, as the run counts them.
    values, gradients : int
        Values and gradients among them.
    best : float
        Lowest value.
    success_evaluations, success_values, success_gradients : int or None
        The same counts at the first value below the target; None if there was none.
    curve : tuple of float or None
        Lowest value at each count of :func:`curve_grid`; None where runs end at the target.
    """

    study: str
    algorithm: str
    instance: str
    dimension: int
    gradient: str
    run: int
    budget: int
    evaluations: int
    values: int
    gradients: int
    best: float
    success_evaluations: int | None
    success_values: int | None
    success_gradients: int | None
    curve: tuple[float, ...] | None


def run_cases(
    algorithm: str,
    instance_name: str,
    cases: Sequence[Case],
    seed: int,
    log: Callable[[str], None],
) -> list[Run]:
    """Run one algorithm on one instance.

    Parameters
    ----------
    algorithm : str
        A name in ``ALGORITHMS``.
    instance_name : str
        As for :func:`fletcher_powell.function.instance`.
    cases : sequence of Case
    seed : int
    log : callable
        Receives one line a run.
    """
    import scipy.optimize  # noqa: F401  (loads its BLAS before the threads are limited)

    made = []
    # With one thread the results do not depend on the machine's number of BLAS threads.
    with threadpool_limits(limits=1, user_api="blas"):
        for case in cases:
            for number in case.runs:
                run = run_once(algorithm, instance_name, case, number, seed)
                made.append(run)
                log(
                    f"{run.study} n={run.dimension} run {run.run}: best {run.best:.3g}, "
                    f"target after {run.success_evaluations} of {run.evaluations} evaluations"
                )
    return made


def run_once(algorithm: str, instance_name: str, case: Case, number: int, seed: int) -> Run:
    """Make one run of a case; see :func:`run_cases`."""
    problem = instance(instance_name, case.dimension)
    until_target = case.study in UNTIL_TARGET
    objective = Objective(
        problem, case.gradient, case.evaluations, TARGET if until_target else problem.precision
    )
    generator = np.random.default_rng(_seed_sequence(seed, algorithm, instance_name, case, number))
    with suppress(RunOver):
        ALGORITHMS[algorithm].search(objective, generator)
    success = objective.success
    return Run(
        study=case.study,
        algorithm=algorithm,
        instance=instance_name,
        dimension=case.dimension,
        gradient=case.gradient,
        run=number,
        budget=case.evaluations,
        evaluations=objective.evaluations,
        values=objective.value_count,
        gradients=objective.gradient_count,
        best=objective.best,
        success_evaluations=success.evaluations if success else None,
        success_values=success.values if success else None,
        success_gradients=success.gradients if success else None,
        curve=None if until_target else _curve(objective.improvements, case.evaluations),
    )


def curve_grid(budget: int) -> NDArray[np.int64]:
    """Evaluation counts at which a convergence curve is sampled."""
    return np.unique(np.geomspace(10, budget, CURVE_POINTS).round().astype(np.int64))


def _curve(improvements: Sequence[tuple[int, float]], budget: int) -> tuple[float, ...]:
    """Lowest value at each count of the grid; before the first value, that value."""
    counts = np.array([count for count, _ in improvements])
    values = np.array([value for _, value in improvements])
    last = np.searchsorted(counts, curve_grid(budget), side="right") - 1
    return tuple(values[np.maximum(last, 0)].tolist())


def _seed_sequence(
    seed: int, algorithm: str, instance_name: str, case: Case, number: int
) -> np.random.SeedSequence:
    """Seeds keyed by what is run; the bytes of the names are read as an integer."""
    words = f"{case.study} {algorithm} {instance_name}"
    return np.random.SeedSequence(
        seed, spawn_key=(case.dimension, number, int.from_bytes(words.encode(), "little"))
    )
