"""Initial conditions of a simulation, from a stretch of measured output."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.armax import ArmaxModel

Array = NDArray[np.float64]


def estimate_initial_state(model: ArmaxModel, input: Array, output: Array) -> Array:  # noqa: A002
    """State of ``1/A`` before the first sample whose free response best explains an output.

    Least squares on ``output - G u`` over the whole stretch given; (na,).  What the input did
    before the stretch only reaches the output through the same delay line after the first
    ``nk + nb - 1`` samples, which are therefore left out of the fit.

    Parameters
    ----------
    model : ArmaxModel
        Stable.
    input, output : (N,) arrays
    """
    from scipy.signal import lfilter

    na = len(model.a) - 1
    if na == 0:
        return np.empty(0)
    first = min(model.nk + len(model.b) - 1, len(output) - 2 * na)
    first = max(first, 0)
    remainder = np.asarray(output, dtype=float) - model.simulate(input)
    silence = np.zeros(len(remainder))
    free = np.column_stack([lfilter([1.0], model.a, silence, zi=unit)[0] for unit in np.eye(na)])
    scale = np.linalg.norm(free[first:], axis=0)
    scale[scale == 0.0] = 1.0
    state = np.linalg.lstsq(free[first:] / scale, remainder[first:], rcond=None)[0] / scale
    return np.asarray(state)
