"""States of linear recursions, by compiled code."""

import numpy as np

from evopem.compilation import DECAYED, cached_njit


@cached_njit
def driven_states(A, initial, inputs, bounds):
    """p solutions of ``x+ = A x + inputs``, (N, p, n), from initial states (segments, p, n)."""
    states, columns = np.empty(inputs.shape), A.T.copy()
    count, n = inputs.shape[1:]
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
                    after[i] = inputs[t, p, i]
                for j in range(n):
                    for i in range(n):
                        after[i] += columns[j, i] * now[j]
                for i in range(n):
                    if abs(after[i]) <= DECAYED:
                        after[i] = 0.0
    return states
