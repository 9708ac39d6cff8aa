"""Models in state space, estimated order by order."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from evopem.automatic.cross_validation.folds import LONG, is_large
from evopem.automatic.fit import CommonSettings, Fit
from evopem.config.settings import OutputWeighting
from evopem.config.structures import OF_ABSOLUTE_ERRORS, STATE_SPACE_FORMS
from evopem.estimation.search.problem import Log
from evopem.estimation.state_space.estimate import RISES, estimates_of_orders
from evopem.estimation.state_space.local_estimates import (
    StateSpaceEstimate,
    StateSpaceTask,
    refitted,
)
from evopem.estimation.state_space.problem import STEPS
from evopem.estimation.state_space.search import FINAL_WIDTH, NO_MODELS, WIDTH, likeliest_order
from evopem.estimation.state_space.starting_models import USUAL_ORDER
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording, Segment

# Estimates of each order that are descended from on large records, whose estimates are good ones,
# and steps of these descents; also of those on folds of long records, from the optimum of all.
LARGE_WIDTH, LARGE_STEPS = 2, 12
# Number of states from which on a search without an input is shortened, and states below those of
# the likeliest estimate by linear algebra at which it begins then.
MANY_ALONE, BELOW = 14, 8


def from_likeliest(
    stretches: Sequence[Segment], orders: Sequence[int], settings: CommonSettings
) -> tuple[int, ...]:
    """The orders of a search without an input, less small ones where it has many states."""
    task = task_of(recording_of(stretches), "ss", (), settings)
    likeliest = likeliest_order(task.errors(recording_of(stretches), orders[-1]), orders)
    first = likeliest - BELOW if likeliest >= MANY_ALONE else orders[0]
    return tuple(order for order in orders if order >= first)


def weighting_of(structure: str, settings: CommonSettings) -> OutputWeighting:
    """The weighting of the outputs of a structure in state space."""
    built_in = STATE_SPACE_FORMS[structure]
    if settings.objective == "absolute":
        built_in = OF_ABSOLUTE_ERRORS
    return settings.weighting or built_in  # type: ignore[return-value]


def recording_of(stretches: Sequence[Segment]) -> Recording:
    """Stretches as a recording at 1 Hz."""
    return Recording(stretches[0].inputs, stretches[0].outputs, 1.0).with_segments(stretches)


def fits_in_state_space(
    stretches: Sequence[Segment],
    structure: str,
    orders: Sequence[int],
    delays: tuple[int, ...],
    settings: CommonSettings,
    starts: Mapping[int, StateSpaceModel] = NO_MODELS,
    log: Log | None = None,
) -> Iterator[tuple[int, Fit]]:
    """Fits of ascending numbers of states until their BIC rises.

    ``starts``: models of another form by their order, which are descended from as well.
    None of ``ss_bj`` of large records, where a descent takes too long.
    """
    large, estimation = is_large(stretches), recording_of(stretches)
    if structure == "ss_bj" and large:
        return
    driven = estimation.has_input
    many = orders[0] >= MANY_ALONE - BELOW and orders[-1] >= MANY_ALONE
    quick = large or (many and not driven)
    # Polynomials of equal orders are searched beside the states of one input and one output.
    is_one = stretches[0].inputs.shape[1] == 1 == stretches[0].outputs.shape[1]
    estimates = estimates_of_orders(
        estimation,
        orders,
        structure=structure,  # type: ignore[arg-type]
        delays=delays,
        weighting=weighting_of(structure, settings),
        settings=settings,
        forgets=True,
        width=LARGE_WIDTH if quick else WIDTH if is_one else FINAL_WIDTH,
        steps=LARGE_STEPS if quick else STEPS,
        starts=starts,
        covariances=False,
        log=log,
    )
    first = max(delays, default=0)
    for fitted in until_bic_rises(estimates, driven):
        residuals = tuple(e[np.isfinite(e).all(axis=1)] for e in fitted.residuals)
        yield fitted.order, Fit(fitted.model, fitted.parameters, residuals, first)


def until_bic_rises(
    estimates: Iterable[StateSpaceEstimate], driven: bool = True
) -> Iterator[StateSpaceEstimate]:
    """The estimates by ascending order, up to where the BIC has risen so often that a search ends.

    From the usual largest order on it ends with the first rise, also of the BIC with the colour of
    the errors: states that only describe coloured errors would be added without end.  Where no
    input drives the model, its states describe nothing else, and the BIC alone decides.
    """
    lowest = lowest_coloured = np.inf
    rises = 0
    for estimate in estimates:
        yield estimate
        rises = 0 if estimate.bic < lowest else rises + 1
        falls = rises == 0 and estimate.coloured_bic < lowest_coloured
        if rises >= RISES or (driven and estimate.order >= USUAL_ORDER and not falls):
            return
        lowest = min(lowest, estimate.bic)
        lowest_coloured = min(lowest_coloured, estimate.coloured_bic)


def refit(
    model: StateSpaceModel,
    structure: str,
    stretches: Sequence[Segment],
    delays: tuple[int, ...],
    settings: CommonSettings,
    whole: Sequence[Segment],
) -> StateSpaceModel:
    """The optimum of stretches, parts of whole ones, that a descent from a model ends at.

    Raises ValueError when they are too short, or the descent finds no stable model.
    """
    estimation = recording_of(stretches)
    many = not estimation.has_input and model.order > USUAL_ORDER
    steps = LARGE_STEPS if many or is_large(whole, LONG) else STEPS
    task = task_of(recording_of(whole), structure, delays, settings)
    return refitted(replace(model, covariance=None), estimation, task, steps)


def task_of(
    whole: Recording, structure: str, delays: tuple[int, ...], settings: CommonSettings
) -> StateSpaceTask:
    """What is estimated of a structure in state space."""
    return StateSpaceTask.of(
        whole,
        structure,  # type: ignore[arg-type]
        delays,
        forgets=True,
        weighting=weighting_of(structure, settings),
        settings=settings,
    )
