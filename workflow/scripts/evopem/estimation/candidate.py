"""A candidate of the order search, and the selection of one in each phase."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.estimate import Criteria, Estimate
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.models.armax import ArmaxModel, Orders
from evopem.models.polynomials import max_root_radius

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """The estimate of one order, as it passes between the jobs of an order search.

    Attributes
    ----------
    phase : str
        Phase of the order search.
    orders : Orders
    model : ArmaxModel
        Without the covariance of its parameters.
    criteria : Criteria
    noise_state : (nc,) array
        Contribution of the noise before the first residual to the first nc equation errors.
    minimum : float
        What the search minimised, at its best point.
    at_stability_bound : bool
        Whether a root of A or C lies at the largest radius allowed.
    diagnostics : SearchDiagnostics
    """

    phase: str
    orders: Orders
    model: ArmaxModel
    criteria: Criteria
    noise_state: Array
    minimum: float
    at_stability_bound: bool
    diagnostics: SearchDiagnostics

    @classmethod
    def of(cls, estimate: Estimate, phase: str) -> Candidate:
        """The candidate that an estimate is in a phase."""
        return cls(
            phase=phase,
            orders=estimate.model.orders,
            model=replace(estimate.model, covariance=None),
            criteria=estimate.criteria,
            noise_state=estimate.noise_state,
            minimum=estimate.search.value,
            at_stability_bound=estimate.at_stability_bound,
            diagnostics=estimate.search.diagnostics,
        )

    @property
    def search(self) -> SearchResult:
        """The result of the search, its point being parameters and noise state."""
        point = np.concatenate([self.model.parameters, self.noise_state])
        return SearchResult(point, self.minimum, self.diagnostics)

    @property
    def max_pole_radius(self) -> float:
        """Largest radius of the roots of A."""
        return max_root_radius(self.model.a[1:])

    @property
    def max_noise_zero_radius(self) -> float:
        """Largest radius of the roots of C."""
        return max_root_radius(self.model.c[1:])


@dataclass(frozen=True, eq=False)
class PhaseSelection:
    """The outcome of one phase of the order search.

    Attributes
    ----------
    phase : str
    orders : Orders
        Of the selected candidate.
    reason : str
        Why it was selected, in a sentence.
    candidates : tuple of Candidate
    """

    phase: str
    orders: Orders
    reason: str
    candidates: tuple[Candidate, ...]

    @property
    def selected(self) -> Candidate:
        """The selected candidate."""
        return next(each for each in self.candidates if each.orders == self.orders)
