"""Statistics of the runs: final values, expected evaluations to success, and convergence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fletcher_powell.algorithms import ALGORITHMS
from fletcher_powell.experiments import UNTIL_TARGET
from fletcher_powell.function import instance, wrap
from fletcher_powell.objective import Objective
from fletcher_powell.problem import descend_in_turn
from fletcher_powell.runs import Run, curve_grid

Array = NDArray[np.float64]

STUDIES = ("table", "precise", *UNTIL_TARGET)
# Values below this count as this in P: it is below the rounding error of every instance.
SMALLEST_VALUE = 1e-30
QUANTILES = (0.1, 0.5, 0.9)
REPLICATES = 2000
SEED = 15


@dataclass(frozen=True)
class PublishedResult:
    """P at the end of the runs of one algorithm, as the chapter's table 1 gives it."""

    mean: float
    least: float
    largest: float


# Study, dimension and evaluations of the chapter's table 1. Its instance is not published.
CHAPTER_SETTING = ("table", 20, 200_000)
CHAPTER_TABLE = {
    "hybrid": PublishedResult(-7.15, -8.98, 3.12),
    "es": PublishedResult(3.94, 2.07, 5.20),
    "ep": PublishedResult(4.13, 3.14, 5.60),
    "ga": PublishedResult(4.07, 3.23, 5.05),
}


@dataclass(frozen=True)
class Ratio:
    """Ratio of the expected evaluations of two algorithms, with its 95 % bootstrap interval."""

    value: float
    low: float
    high: float


def progress(best: Sequence[float] | Array) -> Array:
    """P = log10 f of final values (chapter eq. 12)."""
    return np.log10(np.maximum(np.asarray(best, dtype=float), SMALLEST_VALUE))


def runs_table(runs: Sequence[Run]) -> pd.DataFrame:
    """One row for each run: the attributes of `Run` except the curve, and P."""
    table = pd.DataFrame([asdict(run) for run in runs]).drop(columns="curve")
    table["P"] = progress(table["best"])
    successes = ["success_evaluations", "success_values", "success_gradients"]
    table[successes] = table[successes].astype("Int64")
    order = {name: position for position, name in enumerate((*STUDIES, *ALGORITHMS))}
    keys = ["study", "dimension", "algorithm", "instance", "run"]
    return table.sort_values(
        keys, key=lambda column: column.map(order) if column.name in keys[0::2] else column
    ).reset_index(drop=True)


def spent(runs: pd.DataFrame, gradient: str) -> Array:
    """Evaluations of each run until its success, or in all if it had none.

    Parameters
    ----------
    runs : DataFrame
        From :func:`runs_table`.
    gradient : {"differences", "analytic", "own"}
        A gradient counts n, or one, or as the run counted it.
    """
    found = runs["success_evaluations"].notna()
    if gradient == "own":
        counted = runs["success_evaluations"].where(found, runs["evaluations"])
    else:
        cost = runs["dimension"] if gradient == "differences" else 1
        values = runs["success_values"].where(found, runs["values"])
        counted = values + cost * runs["success_gradients"].where(found, runs["gradients"])
    return counted.to_numpy(dtype=float)


def expected_evaluations(evaluations: Array, successes: NDArray[np.bool_]) -> float:
    """Expected evaluations to success: all evaluations over the number of successes.

    Estimates the cost of independent restarts until the first success (Auger and Hansen 2005).
    Infinite without any success.
    """
    return float(evaluations.sum() / successes.sum()) if successes.any() else float("inf")


def resampled(
    evaluations: Array, successes: NDArray[np.bool_], generator: np.random.Generator
) -> Array:
    """Expected evaluations of bootstrap samples of the runs, (REPLICATES,)."""
    drawn = generator.integers(len(evaluations), size=(REPLICATES, len(evaluations)))
    found = successes[drawn].sum(axis=1)
    with np.errstate(divide="ignore"):
        return evaluations[drawn].sum(axis=1) / found


def summary_table(runs: pd.DataFrame) -> pd.DataFrame:
    """One row for each study, dimension and algorithm.

    Columns: ``study`` to ``budget``; ``instances``, ``runs`` and ``successes``; mean, standard
    error, least and largest P (missing where the runs end at the target);
    expected evaluations to success with their 95 % bootstrap interval, as the runs counted them,
    and for either cost of a gradient; P in the chapter's table 1, where the setting is the same.
    """
    rows = []
    for (study, dimension, algorithm), group in runs.groupby(
        ["study", "dimension", "algorithm"], sort=False
    ):
        found = group["success_evaluations"].notna().to_numpy()
        own = spent(group, "own")
        low, high = _interval(resampled(own, found, np.random.default_rng(SEED)))
        final = group["P"] if study not in UNTIL_TARGET else None
        published = (study, dimension, group["budget"].iloc[0]) == CHAPTER_SETTING
        chapter = CHAPTER_TABLE.get(algorithm) if published else None
        rows.append(
            {
                "study": study,
                "dimension": dimension,
                "algorithm": algorithm,
                "label": ALGORITHMS[algorithm].label,
                "gradient": group["gradient"].iloc[0] if group["gradients"].any() else "none",
                "budget": group["budget"].iloc[0],
                "instances": group["instance"].nunique(),
                "runs": len(group),
                "successes": int(found.sum()),
                "P_mean": None if final is None else final.mean(),
                "P_standard_error": None if final is None else final.sem(),
                "P_min": None if final is None else final.min(),
                "P_max": None if final is None else final.max(),
                "expected_evaluations": _finite(expected_evaluations(own, found)),
                "expected_evaluations_low": _finite(low),
                "expected_evaluations_high": _finite(high),
                "expected_if_differences": _finite(
                    expected_evaluations(spent(group, "differences"), found)
                ),
                "expected_if_analytic": _finite(
                    expected_evaluations(spent(group, "analytic"), found)
                ),
                "chapter_mean": chapter.mean if chapter else None,
                "chapter_min": chapter.least if chapter else None,
                "chapter_max": chapter.largest if chapter else None,
            }
        )
    return pd.DataFrame(rows)


def convergence_table(runs: Sequence[Run]) -> pd.DataFrame:
    """Quantiles of P over the runs against the evaluations, for each study and algorithm."""
    tables = []
    curves: dict[tuple[str, str, int], list[tuple[float, ...]]] = {}
    for run in runs:
        if run.curve is not None:
            curves.setdefault((run.study, run.algorithm, run.budget), []).append(run.curve)
    for (study, algorithm, budget), each in curves.items():
        low, median, high = np.quantile(progress(np.array(each)), QUANTILES, axis=0)
        tables.append(
            pd.DataFrame(
                {
                    "study": study,
                    "algorithm": algorithm,
                    "evaluations": curve_grid(budget),
                    "P_10": low,
                    "P_50": median,
                    "P_90": high,
                }
            )
        )
    return pd.concat(tables, ignore_index=True)


def compare(runs: pd.DataFrame, study: str, dimension: int, one: str, other: str) -> Ratio | None:
    """Expected evaluations of one algorithm over those of another, on their common instances.

    None where either has no success.
    """
    generator = np.random.default_rng(SEED)
    there = runs[(runs["study"] == study) & (runs["dimension"] == dimension)]
    pair = [there[there["algorithm"] == algorithm] for algorithm in (one, other)]
    common = set(pair[0]["instance"]) & set(pair[1]["instance"])
    expected, replicates = [], []
    for chosen in (each[each["instance"].isin(common)] for each in pair):
        found = chosen["success_evaluations"].notna().to_numpy(dtype=bool)
        if not found.any():
            return None
        own = spent(chosen, "own")
        expected.append(expected_evaluations(own, found))
        replicates.append(resampled(own, found, generator))
    low, high = _interval(replicates[0] / replicates[1])
    return Ratio(expected[0] / expected[1], low, high)


def _interval(replicates: Array) -> tuple[float, float]:
    # "lower" and "higher" never average a number with infinity.
    low = np.quantile(replicates, 0.025, method="lower")
    return float(low), float(np.quantile(replicates, 0.975, method="higher"))


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def minima_table(name: str, starts: int = 200) -> pd.DataFrame:
    """Minima of an instance of two variables, the lowest first, found by random descents."""
    objective = Objective(instance(name, 2), "analytic", budget=10**9, until=-1.0)
    points = np.random.default_rng(SEED).uniform(-np.pi, np.pi, (starts, 2))
    descents = descend_in_turn(objective, points)
    ends, kept = descents.points, list[int]()
    for row in np.argsort(descents.values, kind="stable"):
        if all(np.max(np.abs(wrap(ends[row] - ends[other]))) > 1e-3 for other in kept):
            kept.append(int(row))
    return pd.DataFrame({"x1": ends[kept, 0], "x2": ends[kept, 1], "f": descents.values[kept]})


def landscape_table(name: str, points: int = 101) -> pd.DataFrame:
    """f of an instance of two variables on a grid of the box (chapter figure 1).

    Parameters
    ----------
    name : str
        As for :func:`fletcher_powell.function.instance`.
    points : int
        Grid points in each direction.
    """
    problem = instance(name, 2)
    axis = np.linspace(-np.pi, np.pi, points)
    x1, x2 = (each.ravel() for each in np.meshgrid(axis, axis, indexing="ij"))
    values = problem.values(np.column_stack([x1, x2]))
    return pd.DataFrame({"x1": x1, "x2": x2, "f": values})
