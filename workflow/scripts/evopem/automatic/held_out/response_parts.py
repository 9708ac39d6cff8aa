"""The parts of a record that hold the response to a single blow.

Most parts of equal length hold noise alone, and where the blow itself is held out, nothing is left
to fit.  Parts of equal energy end with the response, and the first one has the blow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REASON = (
    "Part of the record is silent, as before or after a single blow: the folds divide the energy of"
    " the response, and the first part, with its beginning, is always fitted."
)
"""What a report says where folds are such parts."""

# A part whose input and output both have less than this share of the power of the largest one holds
# hardly any response; this many times the power of its output is noise; the response ends at this
# share of its energy.
LEAST_POWER, ABOVE_NOISE, WHOLE_RESPONSE = 0.1, 2.0, 0.99


def response_parts(inputs: Array, outputs: Array, count: int, shortest: int) -> list[int] | None:
    """Ends of parts of equal energy of the response, the first one included.

    None where each of as many parts of equal length has input or response, there is no input, or
    the response is too short to be divided.
    """
    samples = len(outputs)
    if not inputs.size or samples < count * shortest:
        return None
    edges = np.linspace(0, samples, count + 1).round().astype(int)
    power = _power(outputs)
    of_parts = [
        np.add.reduceat(each, edges[:-1]) / np.diff(edges) for each in (_power(inputs), power)
    ]
    silent = np.all([each < LEAST_POWER * each.max() for each in of_parts], axis=0)
    if not silent.any():
        return None
    blocks = samples // shortest
    of_blocks = power[: blocks * shortest].reshape(blocks, shortest).mean(axis=1)
    noise = ABOVE_NOISE * of_parts[1][silent].min()
    response = np.cumsum(np.maximum(of_blocks - noise, 0.0))
    shares = np.r_[np.arange(1, count) / count, WHOLE_RESPONSE]
    ends = (np.searchsorted(response, shares * response[-1]) + 1) * shortest
    found = [0, *np.unique(ends).tolist()]
    return found if len(found) > 2 else None


def _power(signals: Array) -> Array:
    """Mean power of signals at each sample, (N,), relative to that of each about its mean."""
    squares = (signals - signals.mean(axis=0)) ** 2
    mean = np.maximum(squares.mean(axis=0), np.finfo(float).tiny)
    return np.asarray(np.mean(squares / mean, axis=1))
