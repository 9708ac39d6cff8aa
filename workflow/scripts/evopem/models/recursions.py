"""States of linear recursions, by compiled code."""

import numpy as np

from evopem.compilation import DECAYED, cached_njit


@cached_njit
def driven_states(A, initial, inputs, bounds):
    """p solutions of ``x+ = A x + inputs``, (N, p, n), from initial states (segments, p, n)."""
    states, (count, n) = np.empty(inputs.shape), inputs.shape[1:]
    # Observer forms have hardly any entries: of each row those that are not 0, and where.
    entries, places, ends = A.copy(), np.empty(A.shape, np.intp), np.zeros(n, np.intp)
    for i in range(n):
        for j in range(n):
            if A[i, j] != 0.0:
                entries[i, ends[i]], places[i, ends[i]] = A[i, j], j
                ends[i] += 1
    for segment in range(len(bounds) - 1):
        first, stop = bounds[segment], bounds[segment + 1]
        # An array at once would have messages on its shape compiled: a fifth of all kernels.
        for p in range(count if stop > first else 0):
            for i in range(n):
                states[first, p, i] = initial[segment, p, i]
        for t in range(first, stop - 1):
            for p in range(count):
                now, after = states[t, p], states[t + 1, p]
                for i in range(n):
                    total = inputs[t, p, i]
                    is_full = 3 * ends[i] > n
                    for j in range(n if is_full else 0):
                        total += A[i, j] * now[j]
                    for k in range(0 if is_full else ends[i]):
                        total += entries[i, k] * now[places[i, k]]
                    after[i] = 0.0 if abs(total) <= DECAYED else total
    return states
