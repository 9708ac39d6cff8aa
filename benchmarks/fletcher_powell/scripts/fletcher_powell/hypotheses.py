"""Hypotheses about the algorithms, from the chapter and from this project, tested by the runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pandas as pd

from fletcher_powell.algorithms import ALGORITHMS
from fletcher_powell.experiments import BASIN_HOPPING, DEFAULT, IN_CONTEST, MULTI_START
from fletcher_powell.statistics import Ratio, compare

# Largest difference of a mean P from the chapter's at which the two agree.
SAME_MEAN = 0.5
MACHINE_PRECISION = -20.0


@dataclass(frozen=True)
class Hypothesis:
    """A hypothesis, and the result of its test.

    Attributes
    ----------
    statement : str
    holds : bool or None
        None where the runs do not decide.
    evidence : str
        The numbers, in a sentence.
    """

    statement: str
    holds: bool | None
    evidence: str


def evaluate_hypotheses(summary: pd.DataFrame, runs: pd.DataFrame) -> list[Hypothesis]:
    """Test every hypothesis for which the runs were made.

    Parameters
    ----------
    summary, runs : DataFrame
        From `fletcher_powell.statistics.summary_table` and `runs_table`.
    """
    tested = [
        _solves_all(summary),
        _machine_precision(summary),
        *(_agrees_with_chapter(summary, algorithm) for algorithm in ("es", "ep", "ga")),
        *_against_multi_start(summary, runs),
        *_against_basin_hopping(summary, runs),
        *_refinement(summary, runs),
        *_contest(runs),
    ]
    return [each for each in tested if each is not None]


def _row(summary: pd.DataFrame, study: str, algorithm: str) -> pd.Series | None:
    """Row of an algorithm in a study, in its largest dimension."""
    found = summary[(summary["study"] == study) & (summary["algorithm"] == algorithm)]
    return None if found.empty else found.iloc[-1]


def _final(row: pd.Series) -> str:
    """Sentence with P at the end of the runs, and the chapter's P where it has one."""
    text = (
        f"Mean P {row['P_mean']:.2f} ± {row['P_standard_error']:.2f} "
        f"({row['P_min']:.2f} to {row['P_max']:.2f})"
    )
    if pd.notna(row["chapter_mean"]):
        text += (
            f"; chapter {row['chapter_mean']:.2f} "
            f"({row['chapter_min']:.2f} to {row['chapter_max']:.2f})"
        )
    return text.replace("-", "−") + "."


def _solves_all(summary: pd.DataFrame) -> Hypothesis | None:
    row = _row(summary, "table", "hybrid")
    if row is None:
        return None
    return Hypothesis(
        "The hybrid solves every run with finite differences.",
        bool(row["successes"] == row["runs"]),
        f"{row['successes']} of {row['runs']} runs below 10⁻⁶ within {row['budget']} evaluations. "
        + _final(row),
    )


def _machine_precision(summary: pd.DataFrame) -> Hypothesis | None:
    row = _row(summary, "precise", "hybrid")
    if row is None:
        return None
    return Hypothesis(
        "With analytic gradients every run of the hybrid ends at machine precision.",
        bool(row["P_max"] <= MACHINE_PRECISION),
        f"{_final(row)} A run ends where f is rounding error.",
    )


def _agrees_with_chapter(summary: pd.DataFrame, algorithm: str) -> Hypothesis | None:
    row = _row(summary, "table", algorithm)
    if row is None or pd.isna(row["chapter_mean"]):
        return None
    difference = abs(row["P_mean"] - row["chapter_mean"])
    return Hypothesis(
        f"The mean P of {row['label']} is within {SAME_MEAN:g} of the chapter’s.",
        bool(difference <= SAME_MEAN),
        _final(row),
    )


def _against_multi_start(summary: pd.DataFrame, runs: pd.DataFrame) -> Iterator[Hypothesis | None]:
    for study, words in (("table", "finite differences"), ("precise", "analytic gradients")):
        row = _row(summary, study, "hybrid")
        if row is not None:
            dimension = int(row["dimension"])
            yield _at_most(
                f"At n = {dimension} with {words} the hybrid needs no more evaluations to "
                "success than multi-start BFGS, within the Monte-Carlo error.",
                compare(runs, study, dimension, "hybrid", MULTI_START),
                1.0,
                within_error=True,
            )
    row = _row(summary, "scale", "hybrid")
    if row is not None:
        largest = int(row["dimension"])
        yield _at_most(
            f"At n = {largest} the hybrid needs at most half the evaluations of multi-start BFGS.",
            compare(runs, "scale", largest, "hybrid", MULTI_START),
            0.5,
        )


def _against_basin_hopping(
    summary: pd.DataFrame, runs: pd.DataFrame
) -> Iterator[Hypothesis | None]:
    row = _row(summary, "scale", "hybrid")
    if row is None:
        return
    largest = int(row["dimension"])
    for other in BASIN_HOPPING:
        label = ALGORITHMS[other].label
        statement = f"At n = {largest} the hybrid needs no more evaluations than {label}."
        hopping = _row(summary, "scale", other)
        if hopping is not None and hopping["successes"] == 0:
            yield Hypothesis(
                statement,
                bool(row["successes"] > 0),
                f"{label} solved none of {hopping['runs']} runs.",
            )
        else:
            ratio = compare(runs, "scale", largest, "hybrid", other)
            yield _at_most(statement, ratio, 1.0)


def _refinement(summary: pd.DataFrame, runs: pd.DataFrame) -> Iterator[Hypothesis | None]:
    """The chapter's choice of the worst offspring, against all, the best and random ones."""
    for study in ("table", "scale"):
        row = _row(summary, study, "hybrid")
        if row is None:
            continue
        dimension = int(row["dimension"])
        differences = " (finite differences)" if study == "table" else ""
        for refine, words in (("all", "all"), ("best", "the best"), ("random", "random ones")):
            yield _at_most(
                f"At n = {dimension} refining the worst offspring needs fewer evaluations than "
                f"refining {words}{differences}.",
                compare(runs, study, dimension, "hybrid", f"hybrid-{refine}"),
                1.0,
                strictly=True,
            )


def _contest(runs: pd.DataFrame) -> Iterator[Hypothesis | None]:
    """The default search against each of the best others, in each dimension of the contest."""
    there = runs[runs["study"] == "contest"]
    present = set(there["algorithm"])
    if DEFAULT not in present:
        return
    for dimension in sorted(there["dimension"].unique()):
        for other in IN_CONTEST:
            if other != DEFAULT and other in present:
                yield _at_most(
                    f"At n = {dimension} the default search needs fewer evaluations than "
                    f"{ALGORITHMS[other].label}.",
                    compare(runs, "contest", int(dimension), DEFAULT, other),
                    1.0,
                    strictly=True,
                )


def _at_most(
    statement: str,
    ratio: Ratio | None,
    bound: float,
    within_error: bool = False,
    strictly: bool = False,
) -> Hypothesis | None:
    """Test that a ratio of expected evaluations is at most a bound.

    It fails where the whole interval lies above the bound.  Otherwise it holds where the ratio is
    at most the bound, or with ``within_error`` always, or with ``strictly`` where the whole
    interval lies below the bound; else it is undecided.
    """
    if ratio is None:
        return None
    reached = ratio.low if within_error else ratio.high if strictly else ratio.value
    holds: bool | None = False if ratio.low > bound else None
    if reached < bound or (reached == bound and not strictly):
        holds = True
    return Hypothesis(
        statement,
        holds,
        f"Ratio {ratio.value:.2f}, 95 % interval {ratio.low:.2f} to {ratio.high:.2f}.",
    )
