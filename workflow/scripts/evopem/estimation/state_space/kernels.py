"""Compiled recursions of second-order sections."""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit


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
    p, r = np.empty(count), np.empty(count)
    for record in range(len(bounds) - 1):
        p[:] = pulses[record]
        r[:] = 0.0
        for t in range(bounds[record], bounds[record + 1]):
            for c in range(count):
                was_p, was_r = p[c], r[c]
                out[t, c] = was_p
                out[t, count + c] = was_r
                p[c] = sigma[c] * was_p + back[c] * was_r + signals[t, driven_by[c]]
                r[c] = coupling[c] * was_p + sigma[c] * was_r
    return out
