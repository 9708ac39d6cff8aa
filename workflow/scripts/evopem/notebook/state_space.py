"""State-space estimates that show and draw themselves: one, and ``evopem.estimates_of_orders``."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import wraps
from typing import Any

from evopem.estimation.state_space import estimate
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate
from evopem.notebook.estimate_results import EstimateResults
from evopem.signals.recording import Recording


@dataclass(frozen=True, eq=False, repr=False)
class StateSpaceResults(EstimateResults, StateSpaceEstimate):
    """An estimated state-space model that summarizes, plots, compares and reports itself."""

    asked: tuple[Any, ...] = field(kw_only=True)


@wraps(estimate.estimates_of_orders)
def estimates_of_orders(
    recording: Recording, orders: Sequence[int], **options: Any
) -> Iterator[StateSpaceResults]:
    built_in = {"structure": "ss", "level": True, "settings": None, "weighting": "determinant"}
    *asked, weighting = (options.get(name, value) for name, value in built_in.items())
    for of_order in estimate.estimates_of_orders(recording, orders, **options):
        yield StateSpaceResults(**vars(of_order), asked=(recording, *asked, None, weighting))
