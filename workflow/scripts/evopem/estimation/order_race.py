"""A race of the candidates of a phase: only those that may be selected are searched to the end.

A first pass descends from a few random points for every candidate.  How much a search may gain from
there on is known from measurements (:mod:`.search.likely_gain`), and a candidate that would need
more to be selected is left: after the first pass, or during its search.
A model is never left higher than a nested smaller one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from evopem.config.settings import SearchSettings
from evopem.estimation.candidate import Candidate
from evopem.estimation.search.certificate import Target, gain_after_first_pass, is_certified
from evopem.estimation.search.global_search import FIRST_PASS

# Powers of the residuals that the objectives sum.
POWERS = {"quadratic": 2, "absolute": 1}

SearchOn = Callable[[Candidate, Target | None], Candidate]
Settle = Callable[[Sequence[Candidate]], list[Candidate]]


def first_pass(settings: SearchSettings) -> SearchSettings:
    """Settings of a search that ends after a batch of descents from random points."""
    return replace(settings, evaluations=FIRST_PASS)


def race(
    candidates: Sequence[Candidate],
    phase: str,
    samples: int,
    settings: SearchSettings,
    search_on: SearchOn,
    settle: Settle,
) -> list[Candidate]:
    """Search on those candidates that may be selected, and say of the others why not.

    ``candidates``: all of the phase, after their first pass at least.  ``samples``: N, the scored
    samples.  ``settings``: of the full search.  ``search_on``: takes a candidate and what its
    search is made for, and returns it after its search.  ``settle``: returns the candidates, none
    higher than a nested one.
    """
    settled = list(candidates)
    finished = [_finished(each, settings) for each in settled]
    while True:
        settled = settle(settled)
        gains = [
            0.0 if done else _likely_gain(each, samples)
            for each, done in zip(settled, finished, strict=True)
        ]
        excesses = _excesses_of_delays(settled, gains) if phase == "delay" else _excesses(settled)
        contending = [
            row for row, excess in enumerate(excesses) if not finished[row] and excess <= gains[row]
        ]
        if not contending:
            break
        row = min(contending, key=lambda row: (excesses[row], settled[row].orders))
        target = (
            None if phase == "delay" else _target(settled[row], excesses[row], samples, settings)
        )
        settled[row], finished[row] = search_on(settled[row], target), True
    return [
        each if _finished(each, settings) else replace(each, pruned=_reason(phase, excess, gain))
        for each, excess, gain in zip(settled, excesses, gains, strict=True)
    ]


def _finished(candidate: Candidate, settings: SearchSettings) -> bool:
    found = candidate.diagnostics
    return is_certified(found) or found.evaluations >= settings.evaluations


def _likely_gain(candidate: Candidate, samples: int) -> float:
    gain = gain_after_first_pass(candidate.diagnostics.undiscovered_probability)
    return gain * candidate.orders.parameters / samples


def _target(candidate: Candidate, excess: float, samples: int, settings: SearchSettings) -> Target:
    """The objective at which a candidate's BIC is the lowest."""
    power = POWERS[settings.objective]
    value = candidate.minimum * np.exp(-excess / power)
    return Target(value, candidate.orders.parameters / samples / power)


def _excesses(candidates: Sequence[Candidate]) -> list[float]:
    """How far each candidate's BIC lies above the lowest."""
    lowest = min(each.criteria.bic for each in candidates)
    return [each.criteria.bic - lowest for each in candidates]


def _excesses_of_delays(candidates: Sequence[Candidate], gains: Sequence[float]) -> list[float]:
    """How far the mean BIC of each candidate's delay lies above the lowest, less other gains.

    The candidates of the leading delay have to be searched only when another one may overtake it.
    """
    by_delay: dict[int, list[int]] = defaultdict(list)
    for row, each in enumerate(candidates):
        by_delay[each.orders.single.nk].append(row)
    means = {
        nk: float(np.mean([candidates[row].criteria.bic for row in rows]))
        for nk, rows in by_delay.items()
    }
    reach = {nk: float(np.mean([gains[row] for row in rows])) for nk, rows in by_delay.items()}
    leader = min(sorted(means), key=lambda nk: means[nk])
    excesses = {nk: means[nk] - means[leader] for nk in means}
    rivals = [nk for nk in means if nk != leader and excesses[nk] <= reach[nk]]
    may_win = {*rivals, leader} if rivals else set()
    return [0.0 if each.orders.single.nk in may_win else np.inf for each in candidates]


def _reason(phase: str, excess: float, gain: float) -> str:
    """Why a candidate was left, ``gain`` being 0 where its search had begun."""
    if phase == "delay":
        return "no likely gain of it changes the choice of the delay"
    above = f"its BIC lies {excess:.4f} above the lowest"
    if not gain:
        return f"{above}, more than the rest of its search is likely to gain"
    return f"{above}; full searches rarely gain more than {gain:.4f}"
