"""What the search over orders of several channels has left, to estimate other models from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from evopem.automatic.multi_input_choice import search_structure
from evopem.automatic.multichannel_folds import is_large, is_long
from evopem.automatic.state_space_choice import ModelChoice, scores_of
from evopem.automatic.state_space_chosen import ChosenModel, estimate_as_searched, search_chosen
from evopem.automatic.variant_search import Refit, Variant, VariantSearch, searched_variant
from evopem.config.constraints import Constraints
from evopem.config.settings import OrderRanges, SearchSettings
from evopem.config.structures import is_polynomial
from evopem.estimation.multi_input.order_limits import OrderLimits, joint_orders
from evopem.estimation.state_space.estimate import estimates_of_orders
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate, refitted
from evopem.estimation.state_space.problem import STEPS
from evopem.estimation.state_space.search import FINAL_WIDTH
from evopem.estimation.state_space.task import StateSpaceTask
from evopem.models.stabilization import OrderModels
from evopem.models.state_space import StateSpaceModel, StateSpaceStructure
from evopem.signals.recording import Recording

# Estimates of each order that are descended from on large records, whose estimates are good ones,
# and steps of these descents; also of those on folds of long records, from the optimum of all.
LARGE_WIDTH, LARGE_STEPS = 2, 12


def search_variant(
    estimation: Recording,
    variant: Variant,
    delays: Sequence[int],
    orders: Sequence[int],
    settings: SearchSettings,
    log: Log | None = None,
) -> tuple[VariantSearch, OrderModels]:
    """Estimate every order of a variant, and score it on held-out samples.

    None of ``ss_bj`` on large records, where a descent takes too long.

    Parameters
    ----------
    estimation : Recording
    variant : Variant
    delays, orders : sequence of int
    settings : SearchSettings
    log : callable, optional
    """
    structure: StateSpaceStructure = variant.form  # type: ignore[assignment]
    large = is_large(estimation)
    if structure == "ss_bj" and large:
        return VariantSearch.without_models(variant), OrderModels(())
    estimates = estimates_of_orders(
        estimation,
        orders,
        structure=structure,
        delays=tuple(delays),
        weighting=variant.weighting,
        settings=settings,
        width=LARGE_WIDTH if large else FINAL_WIDTH,
        steps=LARGE_STEPS if large else STEPS,
        log=log,
    )

    task = StateSpaceTask.of(
        estimation, structure, delays, weighting=variant.weighting, settings=settings
    )

    def refit_of(estimate: StateSpaceEstimate) -> Refit:
        model = replace(estimate.model, covariance=None)
        steps = LARGE_STEPS if is_long(estimation) else STEPS
        return lambda training: refitted(model, training, task, steps)

    by_order = ((each.order, each) for each in estimates)
    return searched_variant(
        *(estimation, variant, by_order, lambda each: each.model, refit_of, settings.objective),
        log,
    )


Log = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class SearchedForms:
    """What the search over orders has left, to estimate other models than the chosen one from.

    Attributes
    ----------
    estimation : Recording
    delays : tuple of int
    searches : tuple of VariantSearch
    start : callable
        The model of a variant and an order.
    settings : SearchSettings
    ranges : OrderRanges
    constraints : Constraints, optional
    """

    estimation: Recording
    delays: tuple[int, ...]
    searches: tuple[VariantSearch, ...]
    start: Callable[[Variant, int], StateSpaceModel]
    settings: SearchSettings
    ranges: OrderRanges
    constraints: Constraints | None = None

    def score(self, choice: ModelChoice) -> float:
        """Error for the purpose on held-out samples in percent; infinite where there is none."""
        search = self.search_of(choice.variant)
        if choice.order not in search.orders:
            return np.inf
        scores = getattr(search, scores_of(choice.purpose, choice.level))
        found = float(scores[search.orders.index(choice.order)])
        return found if np.isfinite(found) else np.inf

    def search_of(self, variant: Variant) -> VariantSearch:
        """The search of a variant."""
        return next(each for each in self.searches if each.variant == variant)

    def as_searched(self, choice: ModelChoice) -> ChosenModel:
        """A model next to the one that the search over orders found.

        Raises
        ------
        InputError
            When no model of the order meets the constraints.
        ValueError
            When there is no stable one.
        """
        return self._estimated(estimate_as_searched, choice)

    def searched(self, choice: ModelChoice, log: Log | None = None) -> ChosenModel:
        """The model of a global search.

        Errors are those of :meth:`as_searched`.
        """
        return self._estimated(partial(search_chosen, log=log), choice)

    def with_delays(self, delays: tuple[int, ...], choice: ModelChoice) -> SearchedForms:
        """The search of one variant and order with other delays."""
        variant, settings = choice.variant, self.settings
        if is_polynomial(variant.form):
            limits = OrderLimits.of(self.ranges, self.estimation.input_names)
            orders = {choice.order: joint_orders(variant.form, choice.order, delays, limits)}
            search, models = search_structure(self.estimation, variant, orders, settings)
        else:
            search, models = search_variant(
                self.estimation, variant, delays, (choice.order,), settings
            )
        return replace(
            self,
            delays=delays,
            searches=(search,),
            start=lambda _, order: models.of_order(order),
        )

    def _estimated(self, estimate: Callable[..., ChosenModel], choice: ModelChoice) -> ChosenModel:
        start = self.start(choice.variant, choice.order)
        return estimate(
            *(choice, start, self.estimation, self.delays, self.settings),
            ranges=self.ranges,
            constraints=self.constraints,
        )
