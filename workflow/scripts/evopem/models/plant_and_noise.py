"""A state-space plant without noise model and a noise model without input, in one model.

    A = [[A_plant, 0], [0, A_noise]],  C = [C_plant, C_noise],  K = [0; K_noise],

the state-space counterpart of a Box-Jenkins model (Ljung 1999, section 4.3).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]


def side_by_side(plant: StateSpaceModel, noise: StateSpaceModel) -> StateSpaceModel:
    """One model of both, the states of the plant first.

    Their entries are independent: they are estimated one after the other.
    """
    model = _stacked(plant, noise)
    if plant.covariance is None or noise.covariance is None:
        return model
    entries, more = plant.parameters.size, noise.parameters.size
    numbered = _stacked(
        plant.with_parameters(np.arange(1.0, entries + 1.0)),
        noise.with_parameters(np.arange(entries + 1.0, entries + more + 1.0)),
    )
    # Of each entry of the model that of either, or none: 0.
    source = numbered.parameters.astype(int)
    both = plant.covariance, noise.covariance
    factor, null_space = (
        np.vstack([np.zeros(part.shape[1]), part])[source]
        for part in (
            _diagonal(*(each.factor for each in both)),
            _diagonal(*(each.null_space for each in both)),
        )
    )
    return replace(model, covariance=ParameterCovariance(factor, null_space))


def plant_of(model: StateSpaceModel, states: int) -> StateSpaceModel:
    """The plant of a model made by :func:`side_by_side`, with its part of the covariance."""
    if states == model.order:
        return model
    plant = _first_states(model, states)
    if model.covariance is None:
        return plant
    numbered = model.with_parameters(np.arange(model.parameters.size, dtype=float))
    places = _first_states(numbered, states).parameters.astype(int)
    return replace(plant, covariance=model.covariance.part(places))


def _first_states(model: StateSpaceModel, n: int) -> StateSpaceModel:
    return replace(
        model,
        A=model.A[:n, :n],
        B=model.B[:n],
        C=model.C[:, :n],
        K=model.K[:n],
        structure="ss_oe",
        covariance=None,
    )


def _stacked(plant: StateSpaceModel, noise: StateSpaceModel) -> StateSpaceModel:
    return replace(
        plant,
        A=_diagonal(plant.A, noise.A),
        B=np.vstack([plant.B, np.zeros((noise.order, plant.inputs))]),
        C=np.hstack([plant.C, noise.C]),
        K=np.vstack([plant.K, noise.K]),
        noise_covariance=noise.noise_covariance,
        structure="ss",
        covariance=None,
    )


def _diagonal(first: Array, second: Array) -> Array:
    """The block-diagonal matrix of two."""
    matrix = np.zeros(np.add(first.shape, second.shape))
    matrix[: len(first), : first.shape[1]] = first
    matrix[len(first) :, first.shape[1] :] = second
    return matrix
