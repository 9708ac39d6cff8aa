"""A candidate of the order search, the race between those of a phase, and the selection of one."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import SearchSettings
from evopem.estimation.criteria import Criteria
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.estimation.search.certificate import Target, gain_after_first_pass, has_agreed
from evopem.estimation.search.global_search import FIRST_PASS
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_roots import max_root_radius

POWERS = {"quadratic": 2, "absolute": 1}  # powers of the residuals that the objectives sum

SearchOn = Callable[["Candidate", Target | None], "Candidate"]
Settle = Callable[[Sequence["Candidate"]], list["Candidate"]]


@dataclass(frozen=True, eq=False)
class Candidate:
    """The estimate of one order, as it passes between the jobs of an order search."""

    phase: str
    orders: Orders
    model: PolynomialModel  # without the covariance of its parameters
    criteria: Criteria
    levels: tuple[float, ...]  # these as of PolynomialEstimate
    plant_state: Array
    noise_state: Array
    minimum: float  # what the search minimised, at its best point
    at_stability_bound: bool
    diagnostics: SearchDiagnostics
    pruned: str = ""  # why it was left before the end of its search

    @classmethod
    def of(cls, estimate: PolynomialEstimate, phase: str) -> Self:
        """The candidate that an estimate is in a phase."""
        return cls(
            phase=phase,
            orders=estimate.model.orders,
            model=replace(estimate.model, covariance=None),
            criteria=estimate.criteria,
            levels=estimate.levels,
            plant_state=estimate.plant_state,
            noise_state=estimate.noise_state,
            minimum=estimate.search.value,
            at_stability_bound=estimate.at_stability_bound,
            diagnostics=estimate.search.diagnostics,
        )

    @property
    def search(self) -> SearchResult:
        """The result of the search, its point being parameters, level and states."""
        states = self.plant_state, self.noise_state
        point = np.concatenate([self.model.parameters, self.levels, *states])
        return SearchResult(point, self.minimum, self.diagnostics)

    @property
    def max_pole_radius(self) -> float:
        """Largest radius of the poles of the plant, or of the noise filter where there is none."""
        model = self.model
        others = model.F[0] if model.has_input else model.D
        return max(max_root_radius(model.A[1:]), max_root_radius(others[1:]))

    @property
    def max_noise_zero_radius(self) -> float:
        """Largest radius of the roots of C."""
        return max_root_radius(self.model.C[1:])


@dataclass(frozen=True, eq=False)
class PhaseSelection:
    """The outcome of one phase of the order search."""

    phase: str
    orders: Orders
    reason: str  # in a sentence
    candidates: tuple[Candidate, ...]

    @property
    def selected(self) -> Candidate:
        """The selected candidate."""
        return next(candidate for candidate in self.candidates if candidate.orders == self.orders)


def select_delay(candidates: Sequence[Candidate]) -> tuple[Orders, str]:
    """The orders of the best candidate of the delay with the smallest mean BIC (chapter 5.3)."""
    means, rows = _mean_criteria(candidates)
    selected, *others = sorted(means, key=lambda nk: (means[nk], nk))
    of_delay = [candidates[row] for row in rows[selected]]
    best, spread = min(of_delay, key=_criterion), np.ptp([c.criteria.bic for c in of_delay])
    lead = f", {means[others[0]] - means[selected]:.4f} below the next" if others else ""
    reason = (
        f"A delay of {selected} sample{'' if selected == 1 else 's'} has the smallest mean BIC "
        f"over the orders ({means[selected]:.4f}{lead}); over its orders BIC varies by "
        f"{spread:.4f}."
    )
    return best.orders, reason


def select_order(candidates: Sequence[Candidate]) -> tuple[Orders, str]:
    """The candidate of smallest BIC (chapter section 5.4)."""
    ranked = sorted(candidates, key=_criterion)
    best = ranked[0]
    reason = (
        f"{best.orders} has the smallest BIC ({best.criteria.bic:.4f}) of {len(ranked)} candidates"
    )
    if len(ranked) > 1:
        second = ranked[1]
        reason += f", {second.criteria.bic - best.criteria.bic:.4f} below {second.orders}"
    return best.orders, reason + "."


def _mean_criteria(
    candidates: Sequence[Candidate],
) -> tuple[dict[int, float], dict[int, list[int]]]:
    """The mean BIC of each delay, and the rows of its candidates."""
    rows: dict[int, list[int]] = defaultdict(list)
    for row, candidate in enumerate(candidates):
        rows[candidate.orders.single.nk].append(row)
    means = {nk: float(np.mean([candidates[row].criteria.bic for row in rows[nk]])) for nk in rows}
    return means, rows


def _criterion(candidate: Candidate) -> tuple[float, Orders]:
    """BIC, and the smaller model where it ties."""
    return candidate.criteria.bic, candidate.orders


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
    """Search on those candidates that may be selected, and say of the others why not. How much a
    search may gain after its first pass is known from measurements; a candidate that would need
    more to be selected is left then, or during its search. ``samples``: those scored. ``search_on``
    takes a candidate and what its search is made for; ``settle`` returns the candidates, none
    higher than a nested one."""
    settled = list(candidates)
    finished = [_finished(candidate, settings) for candidate in settled]
    while True:
        settled = settle(settled)
        unknown = [candidate.diagnostics.undiscovered_probability for candidate in settled]
        gains = [
            0.0 if done else gain_after_first_pass(share) * c.orders.parameters / samples
            for c, done, share in zip(settled, finished, unknown, strict=True)
        ]
        excesses = _excesses(settled, phase, gains)
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
        c if _finished(c, settings) else replace(c, pruned=_reason(phase, excess, gain))
        for c, excess, gain in zip(settled, excesses, gains, strict=True)
    ]


def _finished(candidate: Candidate, settings: SearchSettings) -> bool:
    diagnostics = candidate.diagnostics
    return has_agreed(diagnostics) or diagnostics.evaluations >= settings.evaluations


def _target(candidate: Candidate, excess: float, samples: int, settings: SearchSettings) -> Target:
    """The objective at which a candidate's BIC is the lowest."""
    power = POWERS[settings.objective]
    value = candidate.minimum * np.exp(-excess / power)
    return Target(value, candidate.orders.parameters / samples / power)


def _excesses(candidates: Sequence[Candidate], phase: str, gains: Sequence[float]) -> list[float]:
    """How far each candidate's BIC lies above the lowest. Of delays 0 or infinite: a delay has to
    be searched only when another one may overtake it."""
    if phase != "delay":
        lowest = min(candidate.criteria.bic for candidate in candidates)
        return [candidate.criteria.bic - lowest for candidate in candidates]
    means, rows = _mean_criteria(candidates)
    reach = {nk: float(np.mean([gains[row] for row in rows[nk]])) for nk in rows}
    leader = min(sorted(means), key=lambda nk: means[nk])
    rivals = [nk for nk in means if nk != leader and means[nk] - means[leader] <= reach[nk]]
    may_win = {*rivals, leader} if rivals else set()
    return [0.0 if candidate.orders.single.nk in may_win else np.inf for candidate in candidates]


def _reason(phase: str, excess: float, gain: float) -> str:
    """Why a candidate was left, ``gain`` being 0 where its search had begun."""
    if phase == "delay":
        return "no likely gain of it changes the choice of the delay"
    above = f"its BIC lies {excess:.4f} above the lowest"
    if not gain:
        return f"{above}, more than the rest of its search is likely to gain"
    return f"{above}; full searches rarely gain more than {gain:.4f}"
