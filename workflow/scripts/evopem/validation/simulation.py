"""Pure simulation: the response to the input alone, never to a measured output.

The initial conditions are estimated by least squares. A simulation begins at the first sample
whose whole input history is on record, t0 = nb + nk − 1; from there on the part of the response
that the record does not explain is a free response of 1/A, which has exactly na degrees of
freedom. So na numbers are fitted, none for the input's unknown past, and the samples before t0 are
left out.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from evopem.models.armax import ArmaxModel

# A free response that has decayed to this share of its start tells nothing about its start.
DECAYED = 1e-9


def free_responses(a: ArrayLike, samples: int) -> NDArray[np.float64]:
    """Free responses of 1/A from na linearly independent initial states.

    Parameters
    ----------
    a : array_like, shape (na + 1,)
        Coefficients of A with the leading 1.
    samples : int
        Length of each response.

    Returns
    -------
    ndarray, shape (samples, na)
        Each column x obeys A(q) x = 0 from the first sample on.
    """
    from scipy.signal import lfilter

    a = np.asarray(a, dtype=float)
    order = a.size - 1
    responses = np.empty((samples, order))
    silence = np.zeros(samples)
    for column, state in enumerate(np.eye(order)):
        responses[:, column] = lfilter([1.0], a, silence, zi=state)[0]
    return responses


def simulate_with_initial_conditions(
    model: ArmaxModel, inputs: ArrayLike, output: ArrayLike
) -> NDArray[np.float64]:
    """Simulate over the whole input, initial conditions fitted to the output that is given.

    Parameters
    ----------
    model : ArmaxModel
        The model; its noise polynomial C plays no part.
    inputs : array_like, shape (N,)
        The input over all samples to simulate.
    output : array_like, shape (M,), M <= N
        Measured output over the first M samples. It determines the initial conditions and
        nothing else; samples after M are simulated without knowledge of the output.

    Returns
    -------
    ndarray, shape (N,)
        Simulated output; ``nan`` for the first nb + nk − 1 samples.

    Notes
    -----
    The free responses of a lightly damped model are nearly dependent. They are reduced by a
    singular value decomposition with a relative cut at machine precision, so the fitted response
    is sound where its coefficients are not unique. Rows where every free response has decayed
    carry no information and are left out.
    """
    from scipy.linalg import lstsq
    from scipy.signal import lfilter

    u, y = np.asarray(inputs, dtype=float), np.asarray(output, dtype=float)
    a, b = np.asarray(model.a, dtype=float), np.asarray(model.b, dtype=float)
    start = max(b.size + model.nk - 1, 0)
    if y.size > u.size:
        raise ValueError(f"output has {y.size} samples, input only {u.size}")
    if y.size - start < a.size - 1:
        raise ValueError(f"{y.size} output samples are too few for {a.size - 1} initial conditions")
    numerator = np.concatenate([np.zeros(model.nk), b])
    simulated = lfilter(numerator, a, u) if b.size else np.zeros(u.size)
    simulated[:start] = np.nan
    order = a.size - 1
    if order == 0:
        return simulated
    rows = min(y.size - start, _memory(a))
    responses = free_responses(a, rows)
    scale = np.linalg.norm(responses, axis=0)
    scale[scale == 0] = 1.0
    unexplained = y[start : start + rows] - simulated[start : start + rows]
    weights = lstsq(responses / scale, unexplained, lapack_driver="gelsd")[0] / scale
    # One filter run from the combined state, rather than a matrix over all samples.
    simulated[start:] += lfilter([1.0], a, np.zeros(u.size - start), zi=weights)[0]
    return simulated


def _memory(a: NDArray[np.float64]) -> int:
    """Samples until the slowest free response has decayed, at least 20 for each root."""
    radius = float(np.max(np.abs(np.roots(a)), initial=0.0))
    least = 20 * (a.size - 1)
    if radius >= 1:
        return 10**9
    if radius == 0:
        return least
    return max(least, math.ceil(math.log(DECAYED) / math.log(radius)))
