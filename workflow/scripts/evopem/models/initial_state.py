"""Initial conditions of simulation and prediction, from a stretch of measured signals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.models.armax import ArmaxModel

Array = NDArray[np.float64]


def state_dimension(model: ArmaxModel) -> int:
    """Length of the state of ``G = B/A``: ``max(na, nk + nb - 1)``.

    Examples
    --------
    >>> state_dimension(ArmaxModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=3))
    3
    """
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

    Examples
    --------
    A free decay from 1:

    >>> model = ArmaxModel(np.array([1, -0.5]), np.array([2.0]), np.array([1.0]), nk=1)
    >>> state = estimate_initial_state(model, np.zeros(4), np.array([1, 0.5, 0.25, 0.125]))
    >>> model.simulate(np.zeros(4), initial=state).round(6)
    array([1.   , 0.5  , 0.25 , 0.125])
    """
    remainder = np.asarray(output, dtype=float) - model.simulate(input)
    return _impulses_behind(remainder, model.a, state_dimension(model))


def estimate_noise_state(model: ArmaxModel, input: Array, output: Array) -> Array:  # noqa: A002
    """What the noise before the first residual adds to the first nc equation errors.

    Least squares on the residuals of the whole stretch; (nc,), for
    :meth:`ArmaxModel.residuals` and :meth:`ArmaxModel.predict`.

    Parameters
    ----------
    model : ArmaxModel
        Invertible.
    input, output : (N,) arrays
    """
    residuals = model.residuals(input, output)[model.orders.first_residual :]
    return _impulses_behind(-residuals, model.c, model.orders.nc)


def _impulses_behind(signal: Array, denominator: Array, count: int) -> Array:
    """Impulses at samples 0, 1, ... whose response through ``1/denominator`` fits a signal."""
    from scipy.signal import lfilter

    if count == 0:
        return np.empty(0)
    samples = len(signal)
    count = min(count, samples)
    impulse = np.zeros(samples)
    impulse[0] = 1.0
    response = lfilter([1.0], denominator, impulse)
    responses = np.column_stack(
        [np.concatenate([np.zeros(k), response[: samples - k]]) for k in range(count)]
    )
    impulses: Array = np.linalg.lstsq(responses, signal, rcond=1e-10)[0]
    return impulses
