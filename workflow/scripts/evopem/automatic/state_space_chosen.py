"""Estimation of the state-space models that were chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from evopem.automatic.multi_input_choice import EstimatedStructure, estimate_structure
from evopem.automatic.state_space_choice import ModelChoice
from evopem.automatic.state_space_search import (
    OUTPUT_ERROR_WEIGHTING,
    descended,
    estimate_box_jenkins,
    noise_beside,
    searched_form,
    settings_of,
)
from evopem.config.constraints import InputConstraints
from evopem.config.state_space_settings import OrderRanges, is_polynomial
from evopem.estimation.multi_input.estimate import MultiInputEstimate
from evopem.estimation.multi_input.order_reduction import TriedOrders
from evopem.estimation.state_space.estimate import StateSpaceEstimate, estimate_state_space
from evopem.estimation.state_space.noise_model import side_by_side
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.models.multi_input import MultiInputModel
from evopem.models.state_space import Form, StateSpaceModel
from evopem.signals.multichannel import MultichannelRecording

Log = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class ChosenModel:
    """A chosen model.

    Attributes
    ----------
    estimate : StateSpaceEstimate or MultiInputEstimate
        What was searched: the plant alone in output-error form.
    model : StateSpaceModel
        With the noise model beside an output-error plant; of a polynomial model its innovations
        form.
    polynomials : MultiInputModel, optional
    tried : tuple of TriedOrders
        Orders of a polynomial model that were tried after the joint order.
    at_upper_ends : tuple of str
        Its orders at the upper end of a range of the configuration.
    """

    estimate: StateSpaceEstimate | MultiInputEstimate
    model: StateSpaceModel
    polynomials: MultiInputModel | None = None
    tried: tuple[TriedOrders, ...] = ()
    at_upper_ends: tuple[str, ...] = ()

    @property
    def at_bound(self) -> bool:
        """Whether a root lies at the largest radius allowed."""
        return self.estimate.at_stability_bound

    @classmethod
    def of_polynomials(cls, found: EstimatedStructure) -> ChosenModel:
        """A chosen polynomial model."""
        model = found.estimate.model
        return cls(found.estimate, model.state_space(), model, found.tried, found.at_upper_ends)


def search_chosen(
    choice: ModelChoice,
    searched: StateSpaceModel,
    estimation: MultichannelRecording,
    delays: Sequence[int],
    settings: StateSpaceSettings,
    ranges: OrderRanges | None = None,
    constraints: InputConstraints | None = None,
    log: Log | None = None,
) -> ChosenModel:
    """Search a chosen model globally, the one of the search over orders among the starts.

    Parameters
    ----------
    choice : ModelChoice
    searched : StateSpaceModel
        Of the search over orders.
    estimation : MultichannelRecording
    delays : sequence of int
    settings : StateSpaceSettings
    ranges : OrderRanges, optional
        Of the orders of a polynomial model.
    constraints : InputConstraints, optional
        Of a polynomial model.
    log : callable, optional

    Raises
    ------
    InputError
        When no model of the order meets the constraints.
    ValueError
        When the record is too short.
    """
    form = choice.variant.form
    if is_polynomial(form):
        return ChosenModel.of_polynomials(
            estimate_structure(
                estimation, form, choice.order, delays, settings, ranges, constraints, log=log
            )
        )
    if form == "box_jenkins":
        return _search_box_jenkins(choice, searched, estimation, delays, settings, log)
    own = settings_of(form, estimation, settings)
    estimate = _searched(
        estimation, choice.order, searched_form(form), delays, own, (searched,), log
    )
    return _completed(estimate, estimation, settings)


def estimate_as_searched(
    choice: ModelChoice,
    searched: StateSpaceModel,
    estimation: MultichannelRecording,
    delays: Sequence[int],
    settings: StateSpaceSettings,
    ranges: OrderRanges | None = None,
    constraints: InputConstraints | None = None,
) -> ChosenModel:
    """The optimum that the search over orders found, with its covariance and noise model.

    Parameters and errors as of :func:`search_chosen`.
    """
    form = choice.variant.form
    if is_polynomial(form):
        return ChosenModel.of_polynomials(
            estimate_structure(
                *(estimation, form, choice.order, delays, settings, ranges, constraints),
                globally=False,
            )
        )
    own = settings_of(form, estimation, settings)
    estimate = descended(searched, estimation, delays, own)
    return _completed(estimate, estimation, settings)


def _search_box_jenkins(
    choice: ModelChoice,
    searched: StateSpaceModel,
    estimation: MultichannelRecording,
    delays: Sequence[int],
    settings: StateSpaceSettings,
    log: Log | None,
) -> ChosenModel:
    """The better one of the optima next to the globally searched plant and next to the first."""
    first = replace(settings, weighting=OUTPUT_ERROR_WEIGHTING)
    plant = _searched(estimation, choice.order, "output_error", delays, first, (), log)
    estimates = [
        descended(searched, estimation, delays, settings),
        estimate_box_jenkins(estimation, plant.model, delays, settings),
    ]
    best = min(estimates, key=lambda each: each.bic)
    return ChosenModel(best, best.model)


def _searched(
    estimation: MultichannelRecording,
    order: int,
    form: Form,
    delays: Sequence[int],
    settings: StateSpaceSettings,
    starts: Sequence[StateSpaceModel],
    log: Log | None,
) -> StateSpaceEstimate:
    return estimate_state_space(
        estimation.input_records,
        estimation.output_records,
        order,
        estimation.sampling_rate,
        form=form,
        delays=tuple(delays),
        settings=settings,
        starts=starts,
        input_names=estimation.input_names,
        output_names=estimation.output_names,
        log=log,
    )


def _completed(
    estimate: StateSpaceEstimate,
    estimation: MultichannelRecording,
    settings: StateSpaceSettings,
) -> ChosenModel:
    """A noise model stands beside an output-error plant whose residuals are not white."""
    plant = estimate.model
    if plant.form != "output_error":
        return ChosenModel(estimate, plant)
    noise = noise_beside(plant, estimation, settings)
    return ChosenModel(estimate, plant if noise is None else side_by_side(plant, noise))
