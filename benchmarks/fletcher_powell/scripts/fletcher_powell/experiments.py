"""The runs of the comparison, and their division into jobs.

Four studies: ``table`` is the chapter's table 1, with gradients by finite differences and the
whole budget; ``precise`` is the same with analytic gradients; ``scale`` varies the dimension, with
analytic gradients, and ends a run at the target; ``contest`` is the same in two dimensions, with
enough runs to tell the best algorithms apart.

Imports neither NumPy nor pandas, because the Snakefile imports this module.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fletcher_powell.settings import Settings

HYBRIDS = ("hybrid", "hybrid-all", "hybrid-best", "hybrid-random")
CHAPTER = ("hybrid", "es", "ep", "ga")
SMALL_HYBRID = "hybrid-small"
DEFAULT = "default"
MULTI_START = "multi-start"
MONOTONIC_HOPPING = "monotonic-basin-hopping"
BASIN_HOPPING = ("basin-hopping", MONOTONIC_HOPPING)
# It knows the residuals, as the default search does.
SCIPY_LEAST_SQUARES = "multi-start-least-squares"
# Their libraries take most of their time in Python, so they get fewer runs.
SLOW = (
    "multi-start-scipy",
    "multi-start-lbfgsb",
    SCIPY_LEAST_SQUARES,
    "basin-hopping",
    "cma-es",
    "differential-evolution",
    "dual-annealing",
)
IN_TABLE = (*CHAPTER, *HYBRIDS[1:], DEFAULT, MULTI_START, MONOTONIC_HOPPING, *SLOW)
IN_PRECISE = (*HYBRIDS, MULTI_START)
# In every dimension of the study of scale, and in its largest dimension only.
IN_SCALE = ("hybrid", DEFAULT, MULTI_START, *BASIN_HOPPING)
AT_LARGEST = (*HYBRIDS[1:], SMALL_HYBRID)
IN_CONTEST = (
    "hybrid",
    DEFAULT,
    MULTI_START,
    MONOTONIC_HOPPING,
    SCIPY_LEAST_SQUARES,
    "least-squares-hopping",
)

TAKING_PART = {"table": IN_TABLE, "scale": (*IN_SCALE, *AT_LARGEST), "contest": IN_CONTEST}
PARTS = tuple(TAKING_PART)
"""What one job runs: ``table`` and ``precise`` together, or all dimensions of another study."""

UNTIL_TARGET = ("scale", "contest")
"""Studies whose runs end at the target."""

FIGURES = ("final", "convergence", "refinement", "scale", "landscape")
"""Figures of the page, in its order."""


@dataclass(frozen=True)
class Case:
    """Some runs of one study in one dimension.

    Attributes
    ----------
    study : {"table", "precise", "scale"}
    dimension : int
    gradient : {"differences", "analytic"}
    evaluations : int
        Budget of each run.
    runs : tuple of int
        Numbers of the runs, from 1.
    """

    study: str
    dimension: int
    gradient: str
    evaluations: int
    runs: tuple[int, ...]


def instances(settings: Settings) -> list[str]:
    """Name the instances: the published one first, the others by their seeds."""
    return ["cec2005-f12", *(f"seed-{seed}" for seed in range(1, settings.instances))]


def algorithms(part: str, settings: Settings) -> list[str]:
    """Name the algorithms of a part."""
    return [name for name in TAKING_PART[part] if name in settings.algorithms]


def block_count(part: str, algorithm: str, settings: Settings) -> int:
    """Count the jobs that share the runs of one algorithm on one instance."""
    return math.ceil(_runs(part, algorithm, settings) / settings.runs_per_job)


def cases(part: str, algorithm: str, block: int, settings: Settings) -> list[Case]:
    """List what one job runs.

    Parameters
    ----------
    part : str
        One of ``PARTS``.
    algorithm : str
    block : int
        Number of the job, from 1.
    settings : Settings
    """
    first = (block - 1) * settings.runs_per_job + 1
    last = min(block * settings.runs_per_job, _runs(part, algorithm, settings))
    n = settings.dimension
    if part == "table":
        studies = [("table", n, "differences")]
        if algorithm in IN_PRECISE:
            studies.append(("precise", n, "analytic"))
    else:
        studies = [
            (part, dimension, "analytic") for dimension in _dimensions(part, algorithm, settings)
        ]
    return [
        Case(
            study=study,
            dimension=dimension,
            gradient=gradient,
            evaluations=settings.evaluations * dimension // n,
            runs=tuple(range(first, last + 1)),
        )
        for study, dimension, gradient in studies
    ]


def run_files(settings: Settings) -> list[str]:
    """Name the output of every job: part, algorithm, instance and block."""
    return [
        f"{part}/{algorithm}/{instance}/{block}.json"
        for part in PARTS
        for algorithm in algorithms(part, settings)
        for instance in instances(settings)
        for block in range(1, block_count(part, algorithm, settings) + 1)
    ]


def contested(settings: Settings) -> tuple[int, ...]:
    """Dimensions of the contest: the table's, and the largest one."""
    return tuple(sorted({settings.dimension, max(settings.scale.dimensions)}))


def _dimensions(part: str, algorithm: str, settings: Settings) -> tuple[int, ...]:
    """Dimensions in which an algorithm runs."""
    if part == "contest":
        return contested(settings)
    dimensions = settings.scale.dimensions
    return (max(dimensions),) if algorithm in AT_LARGEST else dimensions


def _runs(part: str, algorithm: str, settings: Settings) -> int:
    """Runs of an algorithm on one instance."""
    runs = settings.scale.runs if part == "scale" else settings.runs
    return min(runs, settings.slow_runs) if algorithm in SLOW else runs
