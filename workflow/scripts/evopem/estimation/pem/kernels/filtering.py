"""Signals filtered through 1/C, for the Jacobian of the residuals."""

from __future__ import annotations

import numpy as np

from evopem.estimation.pem.kernels.cache import cached_njit


@cached_njit
def filter_rows(signals, denominator, states):
    """Filter each row of ``signals`` through ``1/denominator`` in place, and update its state.

    The transposed direct form, operation by operation that of ``scipy.signal.lfilter``, whose
    import takes longer than a small estimate.

    ``signals`` (rows, samples) and ``states`` (rows, m), both C-contiguous; ``denominator``
    (m + 1,) with its leading 1.
    """
    m = states.shape[1]
    z = np.zeros(m + 1)
    for row in range(signals.shape[0]):
        for i in range(m):
            z[i] = states[row, i]
        for t in range(signals.shape[1]):
            filtered = z[0] + signals[row, t]
            for i in range(m):
                z[i] = z[i + 1] - filtered * denominator[i + 1]
            signals[row, t] = filtered
        for i in range(m):
            states[row, i] = z[i]
