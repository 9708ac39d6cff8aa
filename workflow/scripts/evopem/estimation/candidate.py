"""A candidate of the order search, and the selection of one in each phase."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evopem.config.structures import plant_order
from evopem.estimation.criteria import Criteria
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import max_root_radius
from evopem.models.structures import Orders

if TYPE_CHECKING:
    from evopem.estimation.polynomial_estimate import PolynomialEstimate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """The estimate of one order, as it passes between the jobs of an order search.

    ``model``: without the covariance of its parameters. ``with_level``: whether a constant was
    estimated along.  ``plant_state`` (nf,): contribution of the past to the first equations of
    ``F x = -B u``.  ``noise_state`` (max(nc, nd),): contribution of the past to the first equations
    of ``C e = D v``.  ``minimum``: what the search minimised, at its best point.
    ``at_stability_bound``: whether a root of A, C, D or F lies at the largest radius allowed.
    ``pruned``: why it was left before the end of its search; empty where it was not.
    ``further_levels``: of the second and later recordings, where there are several with a level.
    """

    phase: str
    orders: Orders
    model: PolynomialModel
    criteria: Criteria
    with_level: bool
    plant_state: Array
    noise_state: Array
    minimum: float
    at_stability_bound: bool
    diagnostics: SearchDiagnostics
    pruned: str = ""
    further_levels: tuple[float, ...] = ()

    @classmethod
    def of(cls, estimate: PolynomialEstimate, phase: str) -> Candidate:
        """The candidate that an estimate is in a phase."""
        return cls(
            phase=phase,
            orders=estimate.model.orders,
            model=replace(estimate.model, covariance=None),
            criteria=estimate.criteria,
            with_level=estimate.with_level,
            plant_state=estimate.plant_state,
            noise_state=estimate.noise_state,
            minimum=estimate.search.value,
            at_stability_bound=estimate.at_stability_bound,
            diagnostics=estimate.search.diagnostics,
            further_levels=estimate.levels[1:],
        )

    @property
    def search(self) -> SearchResult:
        """The result of the search, its point being parameters, level and states."""
        level = [self.model.level, *self.further_levels] if self.with_level else []
        point = np.concatenate([self.model.parameters, level, self.plant_state, self.noise_state])
        return SearchResult(point, self.minimum, self.diagnostics)

    @property
    def max_pole_radius(self) -> float:
        """Largest radius of the poles of the plant, or of the noise filter where there is none."""
        model = self.model
        others = model.f if model.has_input else model.d
        return max(max_root_radius(model.a[1:]), max_root_radius(others[1:]))

    @property
    def max_noise_zero_radius(self) -> float:
        """Largest radius of the roots of C."""
        return max_root_radius(self.model.c[1:])


@dataclass(frozen=True, eq=False)
class PhaseSelection:
    """The outcome of one phase of the order search.

    ``reason``: why it was selected, in a sentence.
    """

    phase: str
    orders: Orders
    reason: str
    candidates: tuple[Candidate, ...]

    @property
    def selected(self) -> Candidate:
        """The selected candidate."""
        return next(each for each in self.candidates if each.orders == self.orders)

    def over_orders(self, structure: str) -> tuple[Candidate, ...]:
        """The models of every plant order; of several structures, the best of each order by BIC.

        ``structure``: the structure that is looked at, where the phase has several of them.
        """
        structures = {each.orders.structure for each in self.candidates}
        if len(structures) == 1:
            return self.candidates
        best: dict[int, Candidate] = {}
        for each in self.candidates:
            order = getattr(each.orders.single, plant_order(structure))
            own = each.orders.structure == structure
            if own and (order not in best or each.criteria.bic < best[order].criteria.bic):
                best[order] = each
        return tuple(best[order] for order in sorted(best))


def select_delay(candidates: Sequence[Candidate]) -> tuple[Orders, str]:
    """The delay with the smallest mean BIC over the orders (chapter section 5.3).

    The chapter looked for better criteria and for small deviations between the orders; the mean
    rewards both.  The orders returned are those of the delay's best candidate.
    """
    by_delay: dict[int, list[Candidate]] = defaultdict(list)
    for candidate in candidates:
        by_delay[candidate.orders.single.nk].append(candidate)
    means = {nk: float(np.mean([c.criteria.bic for c in group])) for nk, group in by_delay.items()}
    spreads = {nk: float(np.ptp([c.criteria.bic for c in group])) for nk, group in by_delay.items()}
    selected = min(sorted(means), key=lambda nk: means[nk])
    best = min(by_delay[selected], key=_criterion)
    others = [means[nk] for nk in means if nk != selected]
    lead = f", {min(others) - means[selected]:.4f} below the next" if others else ""
    reason = (
        f"A delay of {selected} sample{'' if selected == 1 else 's'} has the smallest mean BIC "
        f"over the orders ({means[selected]:.4f}{lead}); over its orders BIC varies by "
        f"{spreads[selected]:.4f}."
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


def _criterion(candidate: Candidate) -> tuple[float, Orders]:
    """BIC, and the smaller model where it ties."""
    return candidate.criteria.bic, candidate.orders
