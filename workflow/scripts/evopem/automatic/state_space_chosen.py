"""Estimation of the state-space models that were chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from evopem.automatic.multi_input_choice import EstimatedStructure, estimate_structure
from evopem.automatic.state_space_choice import ModelChoice
from evopem.config.constraints import Constraints
from evopem.config.settings import OrderRanges, SearchSettings
from evopem.config.structures import is_polynomial
from evopem.estimation.multi_input.order_reduction import TriedOrders
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.estimation.state_space.estimate import estimate_state_space
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate, descend_from
from evopem.estimation.state_space.noise_model import with_noise_model
from evopem.estimation.state_space.task import StateSpaceTask
from evopem.models.polynomial import PolynomialModel
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording

Log = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class ChosenModel:
    """A chosen model.

    Attributes
    ----------
    estimate : StateSpaceEstimate or PolynomialEstimate
        What was searched: the plant alone in output-error form.
    model : StateSpaceModel
        With the noise model beside an output-error plant; of a polynomial model its innovations
        form.
    polynomials : PolynomialModel, optional
    tried : tuple of TriedOrders
        Orders of a polynomial model that were tried after the joint order.
    at_upper_ends : tuple of str
        Its orders at the upper end of a range of the configuration.
    """

    estimate: StateSpaceEstimate | PolynomialEstimate
    model: StateSpaceModel
    polynomials: PolynomialModel | None = None
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
    estimation: Recording,
    delays: Sequence[int],
    settings: SearchSettings,
    ranges: OrderRanges | None = None,
    constraints: Constraints | None = None,
    log: Log | None = None,
) -> ChosenModel:
    """Search a chosen model globally, the one of the search over orders among the starts.

    Parameters
    ----------
    choice : ModelChoice
    searched : StateSpaceModel
        Of the search over orders.
    estimation : Recording
    delays : sequence of int
    settings : SearchSettings
    ranges : OrderRanges, optional
        Of the orders of a polynomial model.
    constraints : Constraints, optional
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
    estimate = estimate_state_space(
        estimation,
        choice.order,
        structure=form,  # type: ignore[arg-type]
        delays=tuple(delays),
        weighting=choice.variant.weighting,
        settings=settings,
        constraints=constraints,
        starts=(searched,),
        log=log,
    )
    return _completed(estimate, estimation, settings)


def estimate_as_searched(
    choice: ModelChoice,
    searched: StateSpaceModel,
    estimation: Recording,
    delays: Sequence[int],
    settings: SearchSettings,
    ranges: OrderRanges | None = None,
    constraints: Constraints | None = None,
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
    if constraints is not None:
        quick = replace(settings, evaluations=0)
        return search_chosen(*(choice, searched, estimation, delays, quick, ranges, constraints))
    task = StateSpaceTask.of(
        estimation,
        form,  # type: ignore[arg-type]
        delays,
        weighting=choice.variant.weighting,
        settings=settings,
    )
    return _completed(descend_from(searched, estimation, task), estimation, settings)


def _completed(
    estimate: StateSpaceEstimate,
    estimation: Recording,
    settings: SearchSettings,
) -> ChosenModel:
    """A noise model stands beside an output-error plant whose residuals are not white."""
    model = estimate.model
    if model.structure == "ss_oe":
        model = with_noise_model(model, estimation, settings)
    return ChosenModel(estimate, model)
