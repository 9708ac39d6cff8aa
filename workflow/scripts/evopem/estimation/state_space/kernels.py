"""Compiled recursions of state-space models, without arrays in between.

Those of a long recording do not fit into a processor's cache.
"""

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit, njit

# Of signals of unit size; below it a free response is 0.  Its own end would be subnormal numbers,
# which it never leaves, and which are a hundred times slower in all that follows.
DECAYED = 1e-150


@njit
def _respond(out, first, stop, sigma, coupling, back, driven_by, pulses, signals):
    """The responses p and r of one segment, in the first ``2 len(sigma)`` columns of ``out``."""
    count = len(sigma)
    out[first, :count] = pulses
    out[first, count : 2 * count] = 0.0
    for t in range(first, stop - 1):
        now, after, z = out[t], out[t + 1], signals[t]
        for c in range(count):
            p, r = now[c], now[count + c]
            next_p = sigma[c] * p + back[c] * r + z[driven_by[c]]
            next_r = coupling[c] * p + sigma[c] * r
            after[c] = next_p if abs(next_p) > DECAYED else 0.0
            after[count + c] = next_r if abs(next_r) > DECAYED else 0.0


@njit
def _advance(p, r, sigma, coupling, back, z):
    """One sample of sections whose p and r (S,) are overwritten."""
    for c in range(len(p)):
        next_p = sigma[c] * p[c] + back[c] * r[c] + z[c]
        next_r = coupling[c] * p[c] + sigma[c] * r[c]
        p[c] = next_p if abs(next_p) > DECAYED else 0.0
        r[c] = next_r if abs(next_r) > DECAYED else 0.0


@cached_njit
def derivative_signals(sigma, coupling, back, driven_by, pulses, signals, ratio, states, bounds):
    """The signals of which derivatives of the states of sections, (N, 2 S), consist.

    The first three hold an entry for each section and signal that drives it, the column
    ``driven_by`` of ``signals``; ``pulses``, (segments, entries), are p at the first sample of each
    segment.

    (N, 2 entries + 4 S): the responses p, then r, of the entries; the derivatives of both states of
    each section by sigma, and s times those by delta.
    """
    pairs, extra = len(ratio), 2 * len(sigma)
    of_state = np.repeat(np.arange(pairs) * (len(sigma) // max(pairs, 1)), 2)
    own_sigma, own_coupling, own_back = sigma[of_state], coupling[of_state], back[of_state]
    out = np.empty((len(signals), extra + 4 * pairs))
    p, r = np.empty(2 * pairs), np.empty(2 * pairs)
    for segment in range(len(bounds) - 1):
        first, stop = bounds[segment], bounds[segment + 1]
        _respond(out, first, stop, sigma, coupling, back, driven_by, pulses[segment], signals)
        p[:] = 0.0
        r[:] = 0.0
        for t in range(first, stop):
            now = out[t]
            for m in range(pairs):
                even, odd = 2 * m, 2 * m + 1
                now[extra + m] = p[even] + r[odd]
                now[extra + pairs + m] = ratio[m] * r[even] + p[odd]
                now[extra + 2 * pairs + m] = r[even]
                now[extra + 3 * pairs + m] = p[even]
            _advance(p, r, own_sigma, own_coupling, own_back, states[t])
    return out


@cached_njit
def driven_states(A, initial, inputs, bounds):
    """p solutions of ``x+ = A x + inputs``, (N, p, n), from initial states (segments, p, n)."""
    states = np.empty(inputs.shape)
    count, n = inputs.shape[1:]
    for segment in range(len(bounds) - 1):
        first, stop = bounds[segment], bounds[segment + 1]
        states[first] = initial[segment]
        for t in range(first, stop - 1):
            for p in range(count):
                for i in range(n):
                    after = inputs[t, p, i]
                    for j in range(n):
                        after += A[i, j] * states[t, p, j]
                    states[t + 1, p, i] = after if abs(after) > DECAYED else 0.0
    return states
