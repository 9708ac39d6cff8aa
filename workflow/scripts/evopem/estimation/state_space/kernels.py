"""Compiled recursions of second-order sections."""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit

# Of signals of unit size; below it a free response is 0.  Its own end would be subnormal numbers,
# which it never leaves, and which are a hundred times slower in all that follows.
DECAYED = 1e-150


@cached_njit
def section_responses(sigma, coupling, back, driven_by, pulses, signals, bounds):
    """Responses of sections ``p+ = sigma p + back r + z, r+ = coupling p + sigma r`` to signals.

    Parameters
    ----------
    sigma, coupling, back : (S,) arrays
        One entry for each section and signal that drives it.
    driven_by : (S,) integer array
        Column of ``signals`` that is z.
    pulses : (records, S) array
        p at the first sample of each record; r is zero there.
    signals : (N, Z) array
    bounds : (records + 1,) integer array
        First sample of each record, and N.

    Returns
    -------
    (N, 2 S) array
        p in the first S columns, r in the others.
    """
    count, samples = len(sigma), len(signals)
    out = np.empty((samples, 2 * count))
    for record in range(len(bounds) - 1):
        first, stop = bounds[record], bounds[record + 1]
        if first < stop:
            out[first, :count] = pulses[record]
            out[first, count:] = 0.0
        for t in range(first, stop - 1):
            now, after, driving = out[t], out[t + 1], signals[t]
            for c in range(count):
                p, r = now[c], now[count + c]
                next_p = sigma[c] * p + back[c] * r + driving[driven_by[c]]
                next_r = coupling[c] * p + sigma[c] * r
                after[c] = next_p if abs(next_p) > DECAYED else 0.0
                after[count + c] = next_r if abs(next_r) > DECAYED else 0.0
    return out
