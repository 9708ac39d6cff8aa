"""Polynomial structures with several inputs: their joint orders, and the model of the chosen one.

They are scored as state-space models are, by BIC and by errors on held-out samples, so that all
forms are compared by the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from evopem.automatic.multichannel_folds import fewest_fitted
from evopem.automatic.searched_orders import VALUES_PER_PARAMETER
from evopem.automatic.variant_search import Refit, Variant, VariantSearch, searched_variant
from evopem.config.constraints import Constraints
from evopem.config.settings import OrderRanges, SearchSettings
from evopem.errors import InputError
from evopem.estimation.multi_input.estimate import (
    estimate_multi_input,
    multi_input_estimates,
    refitted_multi_input,
)
from evopem.estimation.multi_input.order_limits import OrderLimits, joint_orders
from evopem.estimation.multi_input.order_reduction import TriedOrders, reduced_orders
from evopem.estimation.multi_input.search import SETTINGS
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.models.constraint_checks import check_constraints
from evopem.models.stabilization import OrderModels
from evopem.models.state_space import StateSpaceModel
from evopem.models.structures import Orders
from evopem.signals.recording import Recording

Log = Callable[[str], None]

# Largest joint order tried, and largest number of coefficients of B_i, in steps of two, of a model
# without poles.
MOST_POLES, MOST_TAPS = 10, 40


@dataclass(frozen=True, eq=False)
class EstimatedStructure:
    """A polynomial model, and how its orders were found.

    Attributes
    ----------
    estimate : PolynomialEstimate
    tried : tuple of TriedOrders
        Orders of each input that were tried after the joint order.
    at_upper_ends : tuple of str
        Orders that lie at the upper end of a range of the configuration.
    """

    estimate: PolynomialEstimate
    tried: tuple[TriedOrders, ...]
    at_upper_ends: tuple[str, ...]


def searched_joint_orders(
    estimation: Recording,
    structure: str,
    delays: Sequence[int],
    ranges: OrderRanges,
) -> dict[int, Orders]:
    """The orders that are tried, by the joint order k: all that the record can determine.

    Parameters
    ----------
    estimation : Recording
    structure : str
    delays : sequence of int
    ranges : OrderRanges
        Orders follow k within them.  Without ``joint`` k goes on to the largest of their ends.

    Raises
    ------
    InputError
        When the record is too short for any of them, or the ranges are those of other inputs.
    """
    limits = OrderLimits.of(ranges, estimation.input_names)
    without_poles = structure == "fir"
    most = max(MOST_TAPS if without_poles else MOST_POLES, limits.largest)
    low, high = ranges.joint or (1, most)
    steps = 2 if without_poles and ranges == OrderRanges(nk=ranges.nk) else 1
    found: dict[int, Orders] = {}
    for k in range(max(low, steps), high + 1, steps):
        orders = joint_orders(structure, k, delays, limits)
        if not _is_affordable(orders, estimation):
            break
        if orders not in found.values():
            found[k] = orders
    if not found:
        nu = len(delays)
        raise InputError(
            "orders.joint",
            f"{estimation.samples} estimation samples are too few for joint order {low} with {nu}"
            f" input{'s' * (nu > 1)}",
            "record longer, or lower orders.joint and the lower ends of other orders",
        )
    return found


def _is_affordable(orders: Orders, estimation: Recording) -> bool:
    """Whether the smallest training part determines the coefficients."""
    # Each recording has initial states of its own.
    states = (sum(orders.nf) + orders.noise_states) * (len(estimation.segment_starts) - 1)
    return VALUES_PER_PARAMETER * (orders.parameters + states) <= fewest_fitted(estimation)


def search_structure(
    estimation: Recording,
    variant: Variant,
    orders: Mapping[int, Orders],
    settings: SearchSettings,
    log: Log | None = None,
) -> tuple[VariantSearch, OrderModels]:
    """Estimate every joint order of a structure, and score it on held-out samples.

    Parameters
    ----------
    estimation : Recording
        With one output.
    variant : Variant
        Whose form is a structure.
    orders : mapping of int to Orders
        As of :func:`searched_joint_orders`.
    settings : SearchSettings
    log : callable, optional
    """
    search = _search_settings(settings)
    signals = estimation.segment_inputs, estimation.segment_outputs
    estimates = multi_input_estimates(*signals, orders, search, log)

    def plant_of(estimate: PolynomialEstimate) -> StateSpaceModel:
        return estimate.model.plant().state_space()

    def refit_of(estimate: PolynomialEstimate) -> Refit:
        return lambda training: refitted_multi_input(
            estimate.model,
            training.segment_inputs,
            training.segment_outputs,
            search,
        ).state_space()

    return searched_variant(
        *(estimation, variant, estimates, plant_of, refit_of, settings.objective, log)
    )


def estimate_structure(
    estimation: Recording,
    structure: str,
    order: int,
    delays: Sequence[int],
    settings: SearchSettings,
    ranges: OrderRanges | None = None,
    constraints: Constraints | None = None,
    globally: bool = True,
    log: Log | None = None,
) -> EstimatedStructure:
    """The model of a joint order, with orders and delays of each input by BIC.

    Parameters
    ----------
    estimation : Recording
        With one output.
    structure : str
    order : int
    delays : sequence of int
    settings : SearchSettings
    ranges : OrderRanges, optional
        What orders and delays of each input stay within.
    constraints : Constraints, optional
        The search over orders does not know of them.  Where orders by BIC contradict them, those
        of the joint order are kept.
    globally : bool
        Whether it is searched globally, or descended to from estimates alone.
    log : callable, optional

    Raises
    ------
    InputError
        When no model of the order meets the constraints.
    ValueError
        When the record is too short.
    """
    search = _search_settings(settings)
    inputs, outputs = estimation.segment_inputs, estimation.segment_outputs
    limits = OrderLimits.of(ranges or OrderRanges(), estimation.input_names)
    joint = joint_orders(structure, order, delays, limits)
    reduced = reduced_orders(inputs, outputs, joint, search, limits, log)
    orders = reduced.orders
    if constraints is not None and not _allowed(constraints, orders, estimation):
        orders = joint
    estimate = estimate_multi_input(
        *(inputs, outputs, orders, structure, estimation.sampling_rate),
        settings=search if globally else replace(search, evaluations=0),
        constraints=constraints,
        input_names=estimation.input_names,
        output_name=estimation.output_names[0],
        log=log,
    )
    ends = limits.at_upper_ends(orders, estimation.input_names)
    return EstimatedStructure(estimate, reduced.tried, ends)


def _allowed(constraints: Constraints, orders: Orders, estimation: Recording) -> bool:
    """Whether a model of some orders may meet constraints."""
    try:
        check_constraints(constraints, orders, estimation.sampling_rate, estimation.input_names)
    except InputError:
        return False
    return True


def _search_settings(settings: SearchSettings) -> SearchSettings:
    return replace(
        SETTINGS,
        objective=settings.objective,
        seed=settings.seed,
        max_root_radius=settings.max_root_radius,
        evaluations=SETTINGS.evaluations
        if settings.evaluations == SearchSettings.evaluations
        else settings.evaluations,
    )
