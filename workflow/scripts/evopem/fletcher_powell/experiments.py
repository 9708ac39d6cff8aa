"""The runs of the Fletcher-Powell comparison, and how they are cut into jobs.

Three studies: ``table`` is the chapter's table 1, gradients by finite differences and the whole
budget; ``precise`` is the same with analytic gradients; ``scale`` takes other dimensions, analytic
gradients, and stops at the target.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

HYBRIDS = ("hybrid", "hybrid-all", "hybrid-best", "hybrid-random")
CHAPTER = ("hybrid", "es", "ep", "ga")
SMALL_HYBRID = "hybrid-small"
MULTI_START = "multi-start"
BASIN_HOPPING = ("basin-hopping", "monotonic-basin-hopping")
# Their libraries take most of their time in Python, so they get fewer runs.
SLOW = (
    "multi-start-scipy",
    "multi-start-lbfgsb",
    *BASIN_HOPPING,
    "cma-es",
    "differential-evolution",
    "dual-annealing",
)
IN_TABLE = (*CHAPTER, *HYBRIDS[1:], MULTI_START, *SLOW)
IN_PRECISE = (*HYBRIDS, MULTI_START)
# What tells how success grows with the dimension; the rest of the hybrids at the largest only.
IN_SCALE = ("hybrid", MULTI_START, *BASIN_HOPPING)
AT_LARGEST = (*HYBRIDS[1:], SMALL_HYBRID)

PARTS = ("table", "scale")
"""What a job runs: both studies of the table's dimension, or all dimensions of the scale."""

FIGURES = ("final", "convergence", "mutation", "scale", "landscape")
"""The figures of the page, in its order."""


def instances(settings: Mapping[str, Any]) -> list[str]:
    """Name the instances: the citable one first, the others by their seeds."""
    return ["cec2005-f12", *(f"seed-{seed}" for seed in range(1, settings["instances"]))]


def algorithms(part: str, settings: Mapping[str, Any]) -> list[str]:
    """Name the algorithms of a part."""
    own = IN_TABLE if part == "table" else (*IN_SCALE, *AT_LARGEST)
    return [name for name in own if name in settings["algorithms"]]


def block_count(part: str, algorithm: str, settings: Mapping[str, Any]) -> int:
    """Count the jobs into which one algorithm's runs on one instance are cut."""
    return math.ceil(_runs(part, algorithm, settings) / settings["runs_per_job"])


def cases(
    part: str, algorithm: str, block: int, settings: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """List what one job runs: study, dimension, gradient, evaluations, and the runs' numbers.

    Parameters
    ----------
    part : str
        One of ``PARTS``.
    algorithm : str
    block : int
        From 1.
    settings : mapping
        The completed ``fletcher_powell`` of the configuration.
    """
    per_job = settings["runs_per_job"]
    last = min(block * per_job, _runs(part, algorithm, settings))
    runs = list(range((block - 1) * per_job + 1, last + 1))
    n, evaluations = settings["dimension"], settings["evaluations"]
    if part == "table":
        studies = [("table", n, "differences")]
        if algorithm in IN_PRECISE:
            studies.append(("precise", n, "analytic"))
    else:
        dimensions = settings["scale"]["dimensions"]
        if algorithm in AT_LARGEST:
            dimensions = [max(dimensions)]
        studies = [("scale", dimension, "analytic") for dimension in dimensions]
    return [
        {
            "study": study,
            "dimension": dimension,
            "gradient": gradient,
            "evaluations": evaluations * dimension // n,
            "runs": runs,
        }
        for study, dimension, gradient in studies
    ]


def _runs(part: str, algorithm: str, settings: Mapping[str, Any]) -> int:
    """Runs of an algorithm on one instance."""
    runs = settings["runs"] if part == "table" else settings["scale"]["runs"]
    return int(min(runs, settings["slow_runs"]) if algorithm in SLOW else runs)
