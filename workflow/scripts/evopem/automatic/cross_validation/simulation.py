"""Simulation and prediction of stretches, from the initial state that fits what is known."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from evopem.arrays import Array
from evopem.automatic.cross_validation.stretches import joined
from evopem.models.polynomial import Model, simulated_form, state_space_of
from evopem.models.state_space import StateSpaceModel
from evopem.models.states import first_samples
from evopem.signals.recording import Segment
from evopem.validation.responses import unscored_samples

# A pole of a larger radius makes a simulation grow without bound.
STABLE = 1.0 + 1e-9


def errors_simulated_on(
    model: Model,
    before: Segment | None,
    held_out: Segment,
    fitted_level: bool = False,
    robust: bool = False,
) -> Array:
    """Errors of a simulation of the last M held-out samples, (M, l).

    Its initial state is the one that fits the samples before, as in a validation; without any,
    the first tenth of the held-out samples, which are not scored.  A state fitted to scored samples
    would draw slow waves through drifts with poles near the unit circle.  A predictor's state would
    favour models whose noise moves the plant.  With ``fitted_level`` the mean of the errors is
    taken away.  ``robust``: the state is of least absolute deviations, the level the median.
    """
    past = held_out.between(0, 0) if before is None else before
    return errors_with_levels(model, past, held_out, (fitted_level,), robust)[0]


def errors_with_levels(
    model: Model, before: Segment, held_out: Segment, fitted_levels: Sequence[bool], robust: bool
) -> list[Array]:
    """:func:`errors_simulated_on` with the model's level or a fitted one, each as asked for."""
    known, both = before.samples or first_samples(held_out.samples), joined(before, held_out)
    measured = both.outputs[known:]
    simulated = [np.full(measured.shape, np.inf)] * len(fitted_levels)
    with np.errstate(all="ignore"):
        if _radius_of(model) < STABLE:
            given = both.inputs, both.outputs, fitted_levels, robust, known
            simulated = [whole[known:] for whole in _plant_of(model).simulations(*given)]
        centre, errors = np.median if robust else np.mean, [s - measured for s in simulated]
        return [
            e - centre(e, axis=0) if fitted_level else e
            for e, fitted_level in zip(errors, fitted_levels, strict=True)
        ]


# One model after the other is simulated on the held-out parts of a fold, and predicted there.
_plant_of = lru_cache(maxsize=1)(lambda model: simulated_form(model).without_delays())


@lru_cache(maxsize=1)
def _radius_of(model: Model) -> float:
    return float(np.abs(model.poles()).max(initial=0.0))


@lru_cache(maxsize=1)
def _predictor_of(model: Model) -> StateSpaceModel:
    """The model in innovations form, without covariance."""
    return state_space_of(model if model.covariance is None else replace(model, covariance=None))


def simulated(model: Model, stretch: Segment, fitted_level: bool = False) -> Array:
    """Simulation from the initial state that fits the stretch, (N, l).

    With ``fitted_level`` the level is fitted to the stretch as well.
    """
    with np.errstate(all="ignore"):
        if not _radius_of(model) < STABLE:
            return np.full(stretch.outputs.shape, np.inf)
        given = stretch.inputs, stretch.outputs, fitted_level
        return _plant_of(model).simulate_from_fitted_state(*given)


def prediction_errors(model: Model, stretch: Segment, before: Segment | None = None) -> Array:
    """One-step prediction errors, (M, l), of the last M samples.

    Initial states are fitted to all samples, of which those that they and delays determine are not
    scored; with the samples ``before``, none at the beginning of a recording, to these or to the
    first tenth, which are not.  A state of the predictor that were fitted to what is scored would
    draw slow waves through the noise with roots near the unit circle.
    """
    form = _predictor_of(model)
    first = unscored_samples(form, stretch.samples)
    known = stretch.samples
    if before is not None:
        known = max(before.samples or first_samples(known), form.order + first + 2)
        stretch = joined(before, stretch)
    if stretch.samples <= max(first + 1, known if before is not None else 0):
        return np.empty((0, stretch.outputs.shape[1]))
    u, y = stretch.inputs, stretch.outputs
    with np.errstate(all="ignore"):
        errors = form.residuals(u, y, form.prediction_state(u[:known], y[:known]))
    return np.asarray(errors[first if before is None else known :])
