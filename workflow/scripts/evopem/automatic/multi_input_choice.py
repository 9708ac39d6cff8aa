"""Polynomial structures with several inputs: their joint orders, and the model of the chosen one.

They are scored as state-space models are, by BIC and by errors on held-out samples, so that all
forms are compared by the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from evopem.automatic.multichannel_folds import fewest_fitted
from evopem.automatic.state_space_search import (
    VALUES_PER_PARAMETER,
    Refit,
    Variant,
    VariantSearch,
    searched_variant,
)
from evopem.config.constraints import InputConstraints
from evopem.config.settings import SearchSettings
from evopem.config.structures import STRUCTURES
from evopem.errors import InputError
from evopem.estimation.multi_input.constrained import check_input_constraints
from evopem.estimation.multi_input.estimate import (
    SETTINGS,
    MultiInputEstimate,
    estimate_multi_input,
    joint_orders,
    multi_input_estimates,
    reduced_orders,
    refitted_multi_input,
)
from evopem.estimation.state_space.order_models import OrderModels
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.models.multi_input import MultiInputOrders
from evopem.models.state_space import StateSpaceModel
from evopem.signals.multichannel import MultichannelRecording

Log = Callable[[str], None]

# Largest joint order tried, and largest number of coefficients of B_i, in steps of two, of a model
# without poles.
MOST_POLES, MOST_TAPS = 10, 40


def searched_joint_orders(
    estimation: MultichannelRecording, structure: str, limits: tuple[int, int] | None, place: str
) -> tuple[int, ...]:
    """The joint orders that are tried: all that the record can determine.

    Parameters
    ----------
    estimation : MultichannelRecording
    structure : str
    limits : (lower, upper), optional
    place : str
        Configuration key of the data set, for an error to name.

    Raises
    ------
    InputError
        When the record is too short for any of them.
    """
    names, nu = STRUCTURES[structure], estimation.inputs.shape[1]
    without_poles = structure == "fir"
    low, high = limits or (1, MOST_TAPS if without_poles else MOST_POLES)
    noise = {"nc", "nd"}.intersection(names)
    states = nu * ("nf" in names) + bool(noise)
    of_order = nu + nu * ("nf" in names) + len(noise) + ("na" in names)
    # Each recording has initial states of its own.
    of_order += states * (len(estimation.starts) - 1)
    affordable = fewest_fitted(estimation) // VALUES_PER_PARAMETER // of_order
    if affordable < low:
        raise InputError(
            f"{place}.orders.joint",
            f"{estimation.samples} estimation samples are too few for joint order {low} with {nu}"
            f" input{'s' * (nu > 1)}",
            "record longer, or lower orders.joint",
        )
    high = min(high, affordable)
    if without_poles and limits is None:
        return tuple(range(2, max(high, 2) + 1, 2))
    return tuple(range(low, high + 1))


def search_structure(
    estimation: MultichannelRecording,
    variant: Variant,
    delays: Sequence[int],
    orders: Sequence[int],
    settings: StateSpaceSettings,
    log: Log | None = None,
) -> tuple[VariantSearch, OrderModels]:
    """Estimate every joint order of a structure, and score it on held-out samples.

    Parameters
    ----------
    estimation : MultichannelRecording
        With one output.
    variant : Variant
        Whose form is a structure.
    delays, orders : sequence of int
    settings : StateSpaceSettings
    log : callable, optional
    """
    search = _search_settings(settings)
    signals = estimation.input_records, estimation.output_records
    estimates = multi_input_estimates(*signals, variant.form, orders, delays, search, log)

    def plant_of(estimate: MultiInputEstimate) -> StateSpaceModel:
        return estimate.model.plant().state_space()

    def refit_of(estimate: MultiInputEstimate) -> Refit:
        return lambda training: refitted_multi_input(
            estimate.model,
            training.input_records,
            training.output_records,
            search,
        ).state_space()

    return searched_variant(
        *(estimation, variant, estimates, plant_of, refit_of, settings.objective, log)
    )


def estimate_structure(
    estimation: MultichannelRecording,
    structure: str,
    order: int,
    delays: Sequence[int],
    settings: StateSpaceSettings,
    constraints: InputConstraints | None = None,
    globally: bool = True,
    log: Log | None = None,
) -> MultiInputEstimate:
    """The model of a joint order, with orders and delays of each input by BIC.

    Parameters
    ----------
    estimation : MultichannelRecording
        With one output.
    structure : str
    order : int
    delays : sequence of int
    settings : StateSpaceSettings
    constraints : InputConstraints, optional
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
    inputs, outputs = estimation.input_records, estimation.output_records
    joint = joint_orders(structure, order, delays)
    orders = reduced_orders(inputs, outputs, joint, search, log)
    if constraints is not None and not _allowed(constraints, orders, estimation):
        orders = joint
    return estimate_multi_input(
        *(inputs, outputs, orders, structure, estimation.sampling_rate),
        settings=search if globally else replace(search, evaluations=0),
        constraints=constraints,
        input_names=estimation.input_names,
        output_name=estimation.output_names[0],
        log=log,
    )


def _allowed(
    constraints: InputConstraints, orders: MultiInputOrders, estimation: MultichannelRecording
) -> bool:
    """Whether a model of some orders may meet constraints."""
    try:
        check_input_constraints(
            constraints, orders, estimation.input_names, estimation.sampling_rate
        )
    except InputError:
        return False
    return True


def _search_settings(settings: StateSpaceSettings) -> SearchSettings:
    return replace(
        SETTINGS,
        objective=settings.objective,
        seed=settings.seed,
        max_root_radius=settings.max_root_radius,
        evaluations=SETTINGS.evaluations if settings.evaluations is None else settings.evaluations,
    )
