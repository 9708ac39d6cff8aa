"""The chosen model in state space, or of polynomials with several inputs, searched globally."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from evopem.automatic.candidates import Candidate
from evopem.automatic.fit import FitSettings
from evopem.automatic.limits import OrderLimits
from evopem.automatic.state_space import (
    polynomial_settings,
    search_settings,
    task_of,
    weighting_of,
)
from evopem.config.constraints import Constraints
from evopem.errors import InputError
from evopem.estimation.estimate import estimate_polynomial
from evopem.estimation.order_limits import OrderLimits as InputLimits
from evopem.estimation.order_limits import joint_orders
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.estimation.state_space.estimate import estimate_state_space, with_noise_model
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate, descend_from
from evopem.models.constraint_checks import check_constraints
from evopem.models.polynomial import PolynomialModel
from evopem.models.state_space import StateSpaceModel
from evopem.models.structures import Orders
from evopem.signals.recording import Recording

Log = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class ChosenModel:
    """A chosen model."""

    estimate: StateSpaceEstimate | PolynomialEstimate  # of the plant alone in output-error form
    # With the noise model beside an output-error plant; of polynomials their innovations form.
    model: StateSpaceModel
    polynomials: PolynomialModel | None = None
    at_upper_ends: tuple[str, ...] = ()  # its orders at the upper end of a range that is given


def estimate_candidate(
    candidate: Candidate,
    estimation: Recording,
    settings: FitSettings,
    limits: OrderLimits,
    constraints: Constraints | None = None,
    evaluations: int | None = None,
    log: Log | None = None,
) -> ChosenModel:
    """A candidate with its covariance and noise model, its own model among the starts.

    Raises InputError when no model of the order meets the constraints. Raises ValueError when the
    record is too short.
    """
    if candidate.polynomials is not None:
        return _polynomials(candidate, estimation, settings, limits, constraints, evaluations, log)
    structure, model = candidate.structure, candidate.state_space
    assert model is not None
    start = replace(
        model,
        sampling_rate=estimation.sampling_rate,
        input_names=estimation.input_names,
        output_names=estimation.output_names,
    )
    search = search_settings(settings, evaluations)
    if evaluations == 0 and constraints is None:
        task = task_of(estimation, structure, candidate.delays, settings)
        estimate = descend_from(start, estimation, task)
    else:
        estimate = estimate_state_space(
            estimation,
            candidate.order,
            structure=structure,  # type: ignore[arg-type]
            delays=candidate.delays,
            weighting=weighting_of(structure, settings),
            settings=search,
            constraints=constraints,
            starts=(start,),
            log=log,
        )
    found = estimate.model
    if found.structure == "ss_oe":
        found = with_noise_model(found, estimation, search)
    return ChosenModel(estimate, found)


def _polynomials(
    candidate: Candidate,
    estimation: Recording,
    settings: FitSettings,
    limits: OrderLimits,
    constraints: Constraints | None,
    evaluations: int | None,
    log: Log | None,
) -> ChosenModel:
    ends = InputLimits.of(limits.ranges, estimation.input_names)
    orders, structure = candidate.orders, candidate.structure
    if constraints is not None and not _allowed(constraints, orders, estimation):
        orders = joint_orders(structure, candidate.order, candidate.delays, ends)
    estimate = estimate_polynomial(
        estimation,
        replace(orders, structure=structure),
        settings=polynomial_settings(settings, evaluations),
        level=True,
        constraints=constraints,
        log=log,
    )
    at_ends = ends.at_upper_ends(replace(orders, structure=structure), estimation.input_names)
    return ChosenModel(estimate, estimate.model.state_space(), estimate.model, at_ends)


def _allowed(constraints: Constraints, orders: Orders, estimation: Recording) -> bool:
    """Whether a model of some orders may meet constraints."""
    try:
        check_constraints(constraints, orders, estimation.sampling_rate, estimation.input_names)
    except InputError:
        return False
    return True
