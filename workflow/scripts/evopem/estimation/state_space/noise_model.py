"""A noise model beside the plant of an output-error model, from its residuals.

The plant is not changed: simulations stay those that it was fitted for.  Its residuals are modelled
in innovations form without input, and both stand in one model of innovations form,

    A = [[A_plant, 0], [0, A_noise]],  C = [C_plant, C_noise],  K = [0; K_noise],

the state-space counterpart of a Box-Jenkins model (Ljung 1999, section 4.3).  Structure ``ss_bj``
is the optimum of innovations form next to that one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import OutputWeighting, SearchSettings
from evopem.estimation.state_space.local_estimates import (
    StateSpaceEstimate,
    descend_from,
    plain_estimates,
)
from evopem.estimation.state_space.task import StateSpaceTask
from evopem.estimation.vector_autoregression import log_loss
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording, Segment

Array = NDArray[np.float64]

# A search of orders ends after so many of higher BIC; estimates of each order that are descended
# from.
RISES, WIDTH = 2, 3
# Largest order, and output values for each parameter.
MOST_STATES, VALUES_PER_PARAMETER = 10, 5
# Values of all channels from which on orders are tried in steps of two.
LONG = 40_000
# Weighting of the plants that structure ss_bj begins with.
PLANT_WEIGHTING: OutputWeighting = "noise"


def noise_orders(recording: Recording) -> tuple[int, ...]:
    """The orders that are tried for the noise model of a recording."""
    samples, of_order = recording.samples, 1 + len(recording.segment_starts)
    affordable = min(MOST_STATES, samples // 12, samples // VALUES_PER_PARAMETER // of_order)
    if recording.inputs.size + recording.outputs.size > LONG:
        return tuple(range(2, max(affordable, 2) + 1, 2))
    return tuple(range(1, max(affordable, 1) + 1))


def noise_model(
    plant: StateSpaceModel,
    recording: Recording,
    settings: SearchSettings,
    orders: Sequence[int] | None = None,
) -> StateSpaceModel | None:
    """The noise model of lowest BIC for the residuals of a plant; None where they are white.

    Parameters
    ----------
    plant : StateSpaceModel
        Of output-error form.
    recording : Recording
        That it was estimated from.
    settings : SearchSettings
    orders : sequence of int, optional
        Of the noise model, ascending in steps of one or two; those of :func:`noise_orders`.
    """
    lost = max(plant.input_delays, default=0)
    residuals = []
    for segment in recording.segments:
        u, y = segment.inputs, segment.outputs
        left = (y - plant.simulate(u, plant.simulation_state(u, y)))[lost:]
        residuals.append(left - left.mean(axis=0))
    joined = np.vstack(residuals)
    alone = replace(
        recording, inputs=recording.inputs[:, :0], input_names=(), input_units=()
    ).with_segments([Segment(e[:, :0], e, number) for number, e in enumerate(residuals)])
    lowest, best = log_loss(joined, settings.objective), None
    rises = 0
    orders = noise_orders(recording) if orders is None else orders
    for estimate in plain_estimates(alone, orders, StateSpaceTask(settings=settings), WIDTH):
        rises += 1
        if estimate.bic < lowest:
            lowest, best, rises = estimate.bic, estimate.model, 0
        if rises >= RISES:
            break
    return best


def side_by_side(plant: StateSpaceModel, noise: StateSpaceModel) -> StateSpaceModel:
    """One model of a plant without noise model and a noise model without input.

    Parameters
    ----------
    plant : StateSpaceModel
        With K = 0; its states come first.
    noise : StateSpaceModel
    """
    n, m, ny, nu = plant.order, noise.order, plant.outputs, plant.inputs
    A = np.zeros((n + m, n + m))
    A[:n, :n], A[n:, n:] = plant.A, noise.A
    model = replace(
        plant,
        A=A,
        B=np.vstack([plant.B, np.zeros((m, nu))]),
        C=np.hstack([plant.C, noise.C]),
        K=np.vstack([np.zeros((n, ny)), noise.K]),
        noise_covariance=noise.noise_covariance,
        structure="ss",
        covariance=None,
    )
    if plant.covariance is None or noise.covariance is None:
        return model
    return replace(model, covariance=_covariance(model, plant, noise))


def with_noise_model(
    plant: StateSpaceModel, recording: Recording, settings: SearchSettings
) -> StateSpaceModel:
    """An output-error plant with its noise model; alone where its residuals are white.

    Parameters as of :func:`noise_model`.
    """
    noise = noise_model(plant, recording, settings)
    return plant if noise is None else side_by_side(plant, noise)


def estimate_beside(
    plant: StateSpaceModel, recording: Recording, task: StateSpaceTask
) -> StateSpaceEstimate:
    """The optimum of innovations form next to an output-error plant with its noise model.

    Raises
    ------
    ValueError
        When the recording is too short, or the descent ends at no stable model.
    """
    start = with_noise_model(plant, recording, task.settings)
    start = replace(start, structure="ss", covariance=None)
    return descend_from(start, recording, task)


def plant_of(model: StateSpaceModel, states: int) -> StateSpaceModel:
    """The plant of a model made by :func:`side_by_side`, with its part of the covariance."""
    if states == model.order:
        return model
    n, ny = states, model.outputs
    kept = _places(model, slice(0, n), model.inputs)
    covariance = None
    if model.covariance is not None:
        places = np.concatenate(
            [kept["A"], kept["B"], kept["C"], kept["D"], kept["K"], kept["level"]]
        )
        covariance = model.covariance.part(places)
    return replace(
        model,
        A=model.A[:n, :n],
        B=model.B[:n],
        C=model.C[:, :n],
        K=np.zeros((n, ny)),
        structure="ss_oe",
        covariance=covariance,
    )


def _covariance(
    model: StateSpaceModel, plant: StateSpaceModel, noise: StateSpaceModel
) -> ParameterCovariance:
    """Covariance of all entries; plant and noise model are estimated one after the other."""
    n = plant.order
    of_plant = _places(model, slice(0, n), model.inputs)
    of_noise = _places(model, slice(n, model.order), 0)
    factors: list[Array] = []
    null_spaces: list[Array] = []
    for part, places, names in (
        (plant, of_plant, ("A", "B", "C", "D", "K", "level")),
        (noise, of_noise, ("A", "C", "K")),
    ):
        own = _own_places(part, names)
        target = np.concatenate([places[name] for name in names])
        assert part.covariance is not None
        for found, listed in (
            (part.covariance.factor, factors),
            (part.covariance.null_space, null_spaces),
        ):
            spread = np.zeros((model.parameters.size, found.shape[1]))
            spread[target] = found[own]
            listed.append(spread)
    return ParameterCovariance(np.hstack(factors), np.hstack(null_spaces))


def _places(model: StateSpaceModel, states: slice, inputs: int) -> dict[str, NDArray[np.intp]]:
    """Places of the entries that belong to some states, in ``[A, B, C, D, K, level]``."""
    numbers = model.with_parameters(np.arange(model.parameters.size, dtype=float))
    parts = {
        "A": numbers.A[states, states],
        "B": numbers.B[states, :inputs],
        "C": numbers.C[:, states],
        "D": numbers.D,
        "K": numbers.K[states],
        "level": numbers.level,
    }
    return {name: part.ravel().astype(np.intp) for name, part in parts.items()}


def _own_places(model: StateSpaceModel, names: Sequence[str]) -> NDArray[np.intp]:
    numbers = model.with_parameters(np.arange(model.parameters.size, dtype=float))
    return np.concatenate([getattr(numbers, name).ravel().astype(np.intp) for name in names])
