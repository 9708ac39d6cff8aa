"""Simulations of held-out samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.polynomial_states import first_samples
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording

Array = NDArray[np.float64]


def simulated_on(
    model: StateSpaceModel, before: Recording | None, record: Recording, free_level: bool
) -> Array:
    """Response to the inputs of a record, (N, l), from a state that no scored sample determines.

    Those that determine it are NaN.
    """
    u, y = record.inputs, record.outputs
    known = before.samples if before else first_samples(len(y))
    if before is not None:
        u, y = np.concatenate([before.inputs, u]), np.concatenate([before.outputs, y])
    found = model.simulate_from_first(u, y, known, free_level)
    found[:known] = np.nan
    if free_level:
        found = found + np.nanmean(y - found, axis=0)
    return np.asarray(found[-record.samples :])


def simulated_from_fitted_state(
    model: StateSpaceModel, record: Recording, free_level: bool
) -> Array:
    """Response to the inputs of a record from the state that fits its outputs best."""
    return model.simulate_from_fitted_state(record.inputs, record.outputs, free_level)
