"""A noise model beside the plant of an output-error model, from its residuals.

The plant is not changed: simulations stay those that it was fitted for.  Its residuals are modelled
in innovations form without input, and both stand in one model of innovations form,

    A = [[A_plant, 0], [0, A_noise]],  C = [C_plant, C_noise],  K = [0; K_noise],

the state-space counterpart of a Box-Jenkins model (Ljung 1999, section 4.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.likelihood import log_loss
from evopem.estimation.state_space.order_sweep import estimates_of_orders
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]

# A search of orders ends after so many of higher BIC; estimates of each order that are descended
# from.
RISES, WIDTH = 2, 3


def noise_model(
    plant: StateSpaceModel,
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    orders: Sequence[int],
    settings: StateSpaceSettings,
) -> StateSpaceModel | None:
    """The noise model of lowest BIC for the residuals of a plant; None where they are white.

    Parameters
    ----------
    plant : StateSpaceModel
        Of output-error form.
    inputs, outputs : sequences of (N, nu) and (N, ny) arrays
        The records that it was estimated from.
    orders : sequence of int
        Of the noise model, ascending in steps of one or two.
    settings : StateSpaceSettings
    """
    lost = max(plant.input_delays, default=0)
    residuals = [
        (y - plant.simulate(u, plant.simulation_state(u, y)))[lost:]
        for u, y in zip(inputs, outputs, strict=True)
    ]
    residuals = [each - each.mean(axis=0) for each in residuals]
    joined = np.vstack(residuals)
    lowest, best = log_loss(joined, settings.objective), None
    rises = 0
    white = replace(settings, weighting="determinant")
    for estimate in estimates_of_orders(None, residuals, orders, settings=white, width=WIDTH):
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
        form="innovations",
        covariance=None,
    )
    if plant.covariance is None or noise.covariance is None:
        return model
    return replace(model, covariance=_covariance(model, plant, noise))


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
        form="output_error",
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
