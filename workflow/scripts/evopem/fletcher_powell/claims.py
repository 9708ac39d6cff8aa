"""What the chapter, and this project, claim of the comparison, each judged by the runs."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from evopem.fletcher_powell.algorithms import ALGORITHMS
from evopem.fletcher_powell.statistics import comparison

# Largest distance of a mean P from the chapter's that is called the same result.
SAME_MEAN = 0.5
MACHINE_PRECISION = -20.0


@dataclass(frozen=True)
class Claim:
    """A claim and what the runs say of it.

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


def claims(summary: pd.DataFrame, runs: pd.DataFrame) -> list[Claim]:
    """Judge every claim that the runs made can tell about."""
    made = [
        _solves_all(summary),
        _machine_precision(summary),
        *(_same_as_chapter(summary, algorithm) for algorithm in ("es", "ep", "ga")),
        *_against_multi_start(summary, runs),
        *_mutation(summary, runs),
    ]
    return [claim for claim in made if claim is not None]


def _row(summary: pd.DataFrame, study: str, algorithm: str) -> pd.Series | None:
    found = summary[(summary["study"] == study) & (summary["algorithm"] == algorithm)]
    return None if found.empty else found.iloc[-1]


def _final(row: pd.Series) -> str:
    """P at the end of the runs, and the chapter's where it has one."""
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


def _solves_all(summary: pd.DataFrame) -> Claim | None:
    row = _row(summary, "table", "hybrid")
    if row is None:
        return None
    return Claim(
        "The hybrid solves every run with finite differences.",
        bool(row["successes"] == row["runs"]),
        f"{row['successes']} of {row['runs']} runs below 10⁻⁶ within {row['budget']} evaluations. "
        + _final(row),
    )


def _machine_precision(summary: pd.DataFrame) -> Claim | None:
    row = _row(summary, "precise", "hybrid")
    if row is None:
        return None
    return Claim(
        "With analytic gradients every run of the hybrid ends at machine precision.",
        bool(row["P_max"] <= MACHINE_PRECISION),
        f"{_final(row)} A run ends where only the rounding of the function’s own sums is left.",
    )


def _same_as_chapter(summary: pd.DataFrame, algorithm: str) -> Claim | None:
    row = _row(summary, "table", algorithm)
    if row is None or pd.isna(row["chapter_mean"]):
        return None
    distance = abs(row["P_mean"] - row["chapter_mean"])
    return Claim(
        f"{row['label']} lands within {SAME_MEAN:g} of the chapter’s mean.",
        bool(distance <= SAME_MEAN),
        _final(row),
    )


def _against_multi_start(summary: pd.DataFrame, runs: pd.DataFrame) -> list[Claim | None]:
    made: list[Claim | None] = []
    for study, words in (("table", "finite differences"), ("precise", "analytic gradients")):
        row = _row(summary, study, "hybrid")
        if row is None:
            continue
        found = comparison(runs, study, int(row["dimension"]), "hybrid", "multi-start")
        made.append(
            _ratio_claim(
                f"At n = {row['dimension']} with {words} the hybrid needs no more evaluations to "
                "success than multi-start BFGS, within the Monte-Carlo error.",
                found,
                1.0,
                within_error=True,
            )
        )
    row = _row(summary, "scale", "hybrid")
    if row is not None:
        largest = int(row["dimension"])
        made.append(
            _ratio_claim(
                f"At n = {largest} the hybrid needs at most half of what multi-start BFGS needs.",
                comparison(runs, "scale", largest, "hybrid", "multi-start"),
                0.5,
            )
        )
        for other in ("basin-hopping", "monotonic-basin-hopping"):
            name = ALGORITHMS[other].label
            hopping = _largest(summary, other)
            if hopping is not None and hopping["successes"] == 0:
                made.append(
                    Claim(
                        f"At n = {largest} the hybrid needs no more than {name}.",
                        bool(row["successes"] > 0),
                        f"{name} solved none of {hopping['runs']} runs.",
                    )
                )
                continue
            made.append(
                _ratio_claim(
                    f"At n = {largest} the hybrid needs no more than {name}.",
                    comparison(runs, "scale", largest, "hybrid", other),
                    1.0,
                )
            )
    return made


def _largest(summary: pd.DataFrame, algorithm: str) -> pd.Series | None:
    return _row(summary, "scale", algorithm)


def _mutation(summary: pd.DataFrame, runs: pd.DataFrame) -> list[Claim | None]:
    """The chapter's claim: the worst should be mutated, not all, the best or random ones."""
    made: list[Claim | None] = []
    for study in ("table", "scale"):
        row = _row(summary, study, "hybrid")
        if row is None:
            continue
        dimension = int(row["dimension"])
        for mutate, words in (("all", "everyone"), ("best", "the best"), ("random", "random ones")):
            made.append(
                _ratio_claim(
                    f"At n = {dimension} mutating the worst needs fewer evaluations than mutating "
                    f"{words}{' (finite differences)' if study == 'table' else ''}.",
                    comparison(runs, study, dimension, "hybrid", f"hybrid-{mutate}"),
                    1.0,
                    strictly=True,
                )
            )
    return made


def _ratio_claim(
    statement: str,
    found: dict[str, float] | None,
    most: float,
    within_error: bool = False,
    strictly: bool = False,
) -> Claim | None:
    """Judge a ratio of expected evaluations.

    It holds where the ratio is at most ``most``, and fails where all of its interval lies above;
    else it is undecided.  ``within_error``: it holds unless it fails.  ``strictly``: it holds only
    where all of its interval lies below.
    """
    if found is None:
        return None
    reached = found["low"] if within_error else found["high"] if strictly else found["ratio"]
    holds: bool | None = False if found["low"] > most else None
    if reached < most or (reached == most and not strictly):
        holds = True
    return Claim(
        statement,
        holds,
        f"Ratio {found['ratio']:.2f}, 95 % interval {found['low']:.2f} to {found['high']:.2f}.",
    )
