"""Initial conditions of a simulation, from a stretch of measured output."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.armax import ArmaxModel

Array = NDArray[np.float64]


def state_dimension(model: ArmaxModel) -> int:
    """Length of the state of ``G = B/A``: ``max(na, nk + nb - 1)``."""
    return max(len(model.a), model.nk + len(model.b)) - 1


def estimate_initial_state(model: ArmaxModel, input: Array, output: Array) -> Array:  # noqa: A002
    """State before the first sample with which ``G`` best reproduces an output.

    The state gathers all that past inputs and outputs have to do with the future (the delay line
    of the transposed direct form): entry k adds an impulse through ``1/A`` at sample k.  Fitted
    by least squares over the whole stretch, with singular values that the stretch does not
    determine left out.

    Parameters
    ----------
    model : ArmaxModel
        Stable.
    input, output : (N,) arrays

    Returns
    -------
    (state_dimension(model),) array
        For :meth:`ArmaxModel.simulate`.
    """
    from scipy.signal import lfilter

    remainder = np.asarray(output, dtype=float) - model.simulate(input)
    samples, states = len(remainder), state_dimension(model)
    if states == 0:
        return np.empty(0)
    impulse = np.zeros(samples)
    impulse[0] = 1.0
    response = lfilter([1.0], model.a, impulse)
    free = np.column_stack(
        [np.concatenate([np.zeros(k), response[: samples - k]]) for k in range(states)]
    )
    state: Array = np.linalg.lstsq(free, remainder, rcond=1e-10)[0]
    return state
