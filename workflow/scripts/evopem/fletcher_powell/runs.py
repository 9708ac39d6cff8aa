"""Runs of one algorithm on one instance: each by itself, its numbers drawn from its own seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from evopem.fletcher_powell.algorithms import ALGORITHMS
from evopem.fletcher_powell.function import instance
from evopem.fletcher_powell.objective import TARGET, Objective, RunOver

# Points of a convergence curve, evenly spaced in the logarithm of the evaluations.
CURVE_POINTS = 60


def run_cases(
    algorithm: str,
    instance_name: str,
    cases: Sequence[Mapping[str, Any]],
    seed: int,
    log: Callable[[str], None],
) -> list[dict[str, Any]]:
    """Run one algorithm on one instance.

    Parameters
    ----------
    algorithm : str
        A name in ``ALGORITHMS``.
    instance_name : str
    cases : sequence of mappings
        As ``evopem.fletcher_powell.experiments.cases`` lists them.
    seed : int
    log : callable
        Receives one line a run.

    Returns
    -------
    list of dict
        One for each run: what it was, ``evaluations`` spent, ``values`` and ``gradients`` of them,
        ``best`` value, ``success_evaluations`` with ``success_values`` and ``success_gradients``
        (None where the target was not reached), and ``curve``, the best value at the points of
        :func:`curve_grid` (None for the study of scale).
    """
    import scipy.optimize  # noqa: F401  (its own BLAS must be there when the threads are limited)

    records = []
    # The bits of a result must not depend on how many threads the machine's BLAS would take.
    with threadpool_limits(limits=1, user_api="blas"):
        for case in cases:
            for run in case["runs"]:
                record = run_once(algorithm, instance_name, case, run, seed)
                records.append(record)
                log(
                    f"{case['study']} n={case['dimension']} run {run}: best {record['best']:.3g}, "
                    f"target after {record['success_evaluations']} of {record['evaluations']}"
                )
    return records


def run_once(
    algorithm: str, instance_name: str, case: Mapping[str, Any], run: int, seed: int
) -> dict[str, Any]:
    """Make one run; see :func:`run_cases`."""
    problem = instance(instance_name, case["dimension"])
    scale = case["study"] == "scale"
    objective = Objective(
        problem, case["gradient"], case["evaluations"], TARGET if scale else problem.precision
    )
    generator = np.random.default_rng(_sequence(seed, algorithm, instance_name, case, run))
    with suppress(RunOver):
        ALGORITHMS[algorithm].run(objective, generator)
    success = objective.success
    return {
        "study": case["study"],
        "algorithm": algorithm,
        "instance": instance_name,
        "dimension": case["dimension"],
        "gradient": case["gradient"],
        "run": run,
        "budget": case["evaluations"],
        "evaluations": objective.evaluations,
        "values": objective.value_count,
        "gradients": objective.gradient_count,
        "best": objective.best,
        "success_evaluations": success.evaluations if success else None,
        "success_values": success.values if success else None,
        "success_gradients": success.gradients if success else None,
        "curve": None if scale else _curve(objective.improvements, case["evaluations"]),
    }


def curve_grid(budget: int) -> NDArray[np.int64]:
    """Evaluation counts at which a convergence curve is kept."""
    return np.unique(np.geomspace(10, budget, CURVE_POINTS).round().astype(np.int64))


def _curve(improvements: Sequence[tuple[int, float]], budget: int) -> list[float]:
    """Best value at each count of the grid; the first one before there is any."""
    counts = np.array([count for count, _ in improvements])
    values = np.array([value for _, value in improvements])
    last = np.searchsorted(counts, curve_grid(budget), side="right") - 1
    kept: list[float] = values[np.maximum(last, 0)].tolist()
    return kept


def _sequence(
    seed: int, algorithm: str, instance_name: str, case: Mapping[str, Any], run: int
) -> np.random.SeedSequence:
    """Seeds by what is run: names become numbers by their letters."""
    words = f"{case['study']} {algorithm} {instance_name}"
    return np.random.SeedSequence(
        seed, spawn_key=(case["dimension"], run, int.from_bytes(words.encode(), "little"))
    )
