"""The search of state-space models of a structure over its orders."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from evopem.automatic.multichannel_folds import is_large, is_long
from evopem.automatic.variant_search import Refit, Variant, VariantSearch, searched_variant
from evopem.estimation.state_space.estimate import estimates_of_orders, with_drift
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate, refitted
from evopem.estimation.state_space.problem import STEPS
from evopem.estimation.state_space.search import FINAL_WIDTH
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.models.order_models import OrderModels
from evopem.models.state_space import StateSpaceStructure
from evopem.signals.recording import Recording

Log = Callable[[str], None]

# Estimates of each order that are descended from on large records, whose estimates are good ones,
# and steps of these descents; also of those on folds of long records, from the optimum of all.
LARGE_WIDTH, LARGE_STEPS = 2, 12


def search_variant(
    estimation: Recording,
    variant: Variant,
    delays: Sequence[int],
    orders: Sequence[int],
    settings: StateSpaceSettings,
    log: Log | None = None,
) -> tuple[VariantSearch, OrderModels]:
    """Estimate every order of a variant, and score it on held-out samples.

    None of ``ss_bj`` on large records, where a descent takes too long.

    Parameters
    ----------
    estimation : Recording
    variant : Variant
    delays, orders : sequence of int
    settings : StateSpaceSettings
    log : callable, optional
    """
    structure: StateSpaceStructure = variant.form  # type: ignore[assignment]
    large = is_large(estimation)
    if structure == "ss_bj" and large:
        return VariantSearch.without_models(variant), OrderModels(())
    settings = with_drift(settings, structure, estimation)
    estimates = estimates_of_orders(
        estimation,
        orders,
        structure=structure,
        delays=tuple(delays),
        settings=settings,
        width=LARGE_WIDTH if large else FINAL_WIDTH,
        steps=LARGE_STEPS if large else STEPS,
        log=log,
    )

    def refit_of(estimate: StateSpaceEstimate) -> Refit:
        model = replace(estimate.model, covariance=None)
        return lambda training: refitted(
            model,
            training,
            delays=tuple(delays),
            settings=settings,
            steps=LARGE_STEPS if is_long(estimation) else STEPS,
        )

    by_order = ((each.order, each) for each in estimates)
    return searched_variant(
        *(estimation, variant, by_order, lambda each: each.model, refit_of, settings.objective),
        log,
    )
