"""What the runs show: final values, expected evaluations to success, and convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evopem.fletcher_powell.algorithms import ALGORITHMS
from evopem.fletcher_powell.function import instance, wrap
from evopem.fletcher_powell.objective import Objective
from evopem.fletcher_powell.problem import descend_in_turn
from evopem.fletcher_powell.runs import curve_grid

Array = NDArray[np.float64]

STUDIES = ("table", "precise", "scale")
# Study, dimension and evaluations of the chapter's table 1, and its mean, smallest and largest P,
# on matrices that it does not give.
CHAPTER_SETTING = ("table", 20, 200_000)
CHAPTER_TABLE = {
    "hybrid": (-7.15, -8.98, 3.12),
    "es": (3.94, 2.07, 5.20),
    "ep": (4.13, 3.14, 5.60),
    "ga": (4.07, 3.23, 5.05),
}
# Values below this count as this in P: it lies below the rounding of any instance.
SMALLEST_VALUE = 1e-30
QUANTILES = (0.1, 0.5, 0.9)
REPLICATES = 2000
SEED = 15


def progress(best: Sequence[float] | Array) -> Array:
    """P = log10 f of final values (chapter eq. 12)."""
    return np.log10(np.maximum(np.asarray(best, dtype=float), SMALLEST_VALUE))


def runs_table(records: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """One row a run, without its curve."""
    columns = [name for name in records[0] if name != "curve"]
    runs = pd.DataFrame([{name: record[name] for name in columns} for record in records])
    runs["P"] = progress(runs["best"])
    successes = ["success_evaluations", "success_values", "success_gradients"]
    runs[successes] = runs[successes].astype("Int64")
    order = {name: position for position, name in enumerate((*STUDIES, *ALGORITHMS))}
    keys = ["study", "dimension", "algorithm", "instance", "run"]
    return runs.sort_values(
        keys, key=lambda column: column.map(order) if column.name in keys[0::2] else column
    ).reset_index(drop=True)


def spent(runs: pd.DataFrame, gradient: str) -> Array:
    """Evaluations of each run until its success, or in all if it had none, in one counting.

    Parameters
    ----------
    runs : DataFrame
        As :func:`runs_table` makes it.
    gradient : {"differences", "analytic", "own"}
        A gradient counts n, or one, or what it cost the run.
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
    """All evaluations over the number of successes; infinite without any.

    It estimates what independent restarts spend until the first success.
    """
    return float(evaluations.sum() / successes.sum()) if successes.any() else float("inf")


def resampled(
    evaluations: Array, successes: NDArray[np.bool_], generator: np.random.Generator
) -> Array:
    """The same of runs drawn with replacement, (REPLICATES,)."""
    drawn = generator.integers(len(evaluations), size=(REPLICATES, len(evaluations)))
    found = successes[drawn].sum(axis=1)
    with np.errstate(divide="ignore"):
        return evaluations[drawn].sum(axis=1) / found


def summary_table(runs: pd.DataFrame) -> pd.DataFrame:
    """One row for each study, dimension and algorithm.

    Columns: what it is; ``runs`` and ``successes``; mean, standard error, smallest and largest P
    (none for the study of scale, which stops at the target); expected evaluations to success in
    the run's own counting with its 95 % bootstrap interval, and in both countings; what the
    chapter prints.
    """
    rows = []
    for (study, dimension, algorithm), group in runs.groupby(
        ["study", "dimension", "algorithm"], sort=False
    ):
        found = group["success_evaluations"].notna().to_numpy()
        own = spent(group, "own")
        low, high = _interval(resampled(own, found, np.random.default_rng(SEED)))
        final = group["P"] if study != "scale" else None
        printed = (study, dimension, group["budget"].iloc[0]) == CHAPTER_SETTING
        chapter = CHAPTER_TABLE.get(algorithm) if printed else None
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
                "chapter_mean": chapter[0] if chapter else None,
                "chapter_min": chapter[1] if chapter else None,
                "chapter_max": chapter[2] if chapter else None,
            }
        )
    return pd.DataFrame(rows)


def convergence_table(records: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Quantiles of P over the runs against the evaluations, for each study and algorithm."""
    tables = []
    curves: dict[tuple[str, str, int], list[list[float]]] = {}
    for record in records:
        if record["curve"] is not None:
            key = (record["study"], record["algorithm"], record["budget"])
            curves.setdefault(key, []).append(record["curve"])
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


def comparison(
    runs: pd.DataFrame, study: str, dimension: int, one: str, other: str
) -> dict[str, float] | None:
    """Expected evaluations of one algorithm over another's, with its 95 % bootstrap interval.

    Both on the instances that both were run on; None where either has no success there.
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
    return {"ratio": expected[0] / expected[1], "low": low, "high": high}


def _interval(replicates: Array) -> tuple[float, float]:
    # "lower" and "higher" never average a number with infinity.
    low = np.quantile(replicates, 0.025, method="lower")
    return float(low), float(np.quantile(replicates, 0.975, method="higher"))


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def minima_table(name: str, starts: int = 200) -> pd.DataFrame:
    """The minima of an instance of two variables, the lowest first, found by many descents."""
    objective = Objective(instance(name, 2), "analytic", budget=10**9, until=-1.0)
    points = np.random.default_rng(SEED).uniform(-np.pi, np.pi, (starts, 2))
    descents = descend_in_turn(objective, points)
    ends, kept = descents.points, list[int]()
    for row in np.argsort(descents.values, kind="stable"):
        if all(np.max(np.abs(wrap(ends[row] - ends[other]))) > 1e-3 for other in kept):
            kept.append(int(row))
    return pd.DataFrame({"x1": ends[kept, 0], "x2": ends[kept, 1], "f": descents.values[kept]})


def landscape_table(name: str, points: int = 101) -> pd.DataFrame:
    """f of an instance of two variables on a grid of the box (the chapter's figure 1).

    Parameters
    ----------
    name : str
        As for :func:`evopem.fletcher_powell.function.instance`.
    points : int
        Of the grid in each direction.
    """
    problem = instance(name, 2)
    axis = np.linspace(-np.pi, np.pi, points)
    x1, x2 = (each.ravel() for each in np.meshgrid(axis, axis, indexing="ij"))
    values = problem.values(np.column_stack([x1, x2]))
    return pd.DataFrame({"x1": x1, "x2": x2, "f": values})
