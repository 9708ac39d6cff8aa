"""A noise model beside the plant of an output-error model, from its residuals.

The plant is not changed: simulations stay those that it was fitted for.  Its residuals are modelled
in innovations form without input, and both stand in one model of innovations form,

    A = [[A_plant, 0], [0, A_noise]],  C = [C_plant, C_noise],  K = [0; K_noise],

the state-space counterpart of a Box-Jenkins model (Ljung 1999, section 4.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.state_space.estimate import (
    StateSpaceEstimate,
    StateSpaceSettings,
    sweep_state_space_orders,
)
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NoiseOrders:
    """The orders of a noise model, by BIC; order 0 is white noise."""

    orders: tuple[int, ...]
    bic: tuple[float, ...]

    @property
    def best(self) -> int:
        """The order with the lowest BIC."""
        return self.orders[int(np.argmin(self.bic))]


def with_noise_model(
    estimate: StateSpaceEstimate,
    orders: Sequence[int],
    settings: StateSpaceSettings,
    log: Callable[[str], None] | None = None,
) -> tuple[StateSpaceModel, NoiseOrders]:
    """Add the noise model of lowest BIC to an output-error model.

    Parameters
    ----------
    estimate : StateSpaceEstimate
        In output-error form.
    orders : sequence of int
        Orders of the noise model, ascending in steps of one or two; white noise is tried as well.
    settings : StateSpaceSettings
    log : callable, optional

    Returns
    -------
    model : StateSpaceModel
        The model itself where its residuals are white.
    orders : NoiseOrders
    """
    plant = estimate.model
    residuals = [each[np.isfinite(each).all(axis=1)] for each in estimate.residuals]
    joined = np.vstack(residuals)
    white = float(np.linalg.slogdet(joined.T @ joined / len(joined))[1])
    found = sweep_state_space_orders(
        None,
        residuals,
        orders,
        plant.sampling_rate,
        level=False,
        settings=replace(settings, weighting="determinant"),
        folds=False,
        log=log,
    )
    reached = tuple(each.model.order for each in found.estimates)
    tried = NoiseOrders((0, *reached), (white, *map(float, found.bic)))
    if tried.best == 0:
        return plant, tried
    noise = next(each.model for each in found.estimates if each.model.order == tried.best)
    return side_by_side(plant, noise), tried


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
    factors, null_spaces = [], []
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
