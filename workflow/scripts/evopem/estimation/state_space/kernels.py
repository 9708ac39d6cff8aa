"""Compiled recursions of state-space models, without arrays in between.

Those of a long recording do not fit into a processor's cache.
"""

from __future__ import annotations

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
def section_states(sigma, coupling, back, ratio, pulses, drives, bounds):
    """States, (N, 2 S), of S sections that are driven at their first and second state.

    ``pulses``, (segments, 2 S), drive both before the first sample of a segment, ``drives``, (N, 2
    S), at each sample.
    """
    count = len(sigma)
    out = np.empty((len(drives), 2 * count))
    p, r = np.empty((2, count)), np.empty((2, count))
    for segment in range(len(bounds) - 1):
        p[0], p[1] = pulses[segment, :count], pulses[segment, count:]
        r[:] = 0.0
        for t in range(bounds[segment], bounds[segment + 1]):
            now = out[t]
            for m in range(count):
                now[2 * m] = p[0, m] + r[1, m]
                now[2 * m + 1] = ratio[m] * r[0, m] + p[1, m]
            _advance(p[0], r[0], sigma, coupling, back, drives[t, :count])
            _advance(p[1], r[1], sigma, coupling, back, drives[t, count:])
    return out


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
                one, two = 2 * m, 2 * m + 1
                now[extra + m] = p[one] + r[two]
                now[extra + pairs + m] = ratio[m] * r[one] + p[two]
                now[extra + 2 * pairs + m] = r[one]
                now[extra + 3 * pairs + m] = p[one]
            _advance(p, r, own_sigma, own_coupling, own_back, states[t])
    return out


@cached_njit
def driven_states(A, initial, inputs, bounds):
    """``x+ = A x + inputs``, (N, n, p), from initial states (segments, n, p)."""
    states = np.empty(inputs.shape)
    n, count = inputs.shape[1:]
    x, after = np.empty((n, count)), np.empty((n, count))
    for segment in range(len(bounds) - 1):
        x[:] = initial[segment]
        for t in range(bounds[segment], bounds[segment + 1]):
            states[t] = x
            after[:] = inputs[t]
            for i in range(n):
                for j in range(n):
                    for p in range(count):
                        after[i, p] += A[i, j] * x[j, p]
            x, after = after, x
    return states
