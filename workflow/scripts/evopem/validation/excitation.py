"""How well the input excites a model of a given order."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

# An eigenvalue of the input's covariance this far below the largest counts as not excited:
# there the input is 40 dB weaker than where it is strongest.
EXCITED = 1e-4


def excitation_order(inputs: ArrayLike, largest: int) -> int:
    """Number of directions of the input's past that it excites, out of ``largest``.

    ``inputs`` (N,): the input; its mean is removed.  ``largest``: size of the covariance matrix, na
    + nb for an ARMAX model.  Returns the number of its eigenvalues above 10⁻⁴ of the biggest;
    ``largest`` means persistently exciting of that order in practice, not only in rank (Ljung 1999,
    chapter 13).
    """
    u = np.asarray(inputs, dtype=float)
    if u.size < largest or largest < 1 or np.ptp(u) == 0:
        return 0
    u = u - u.mean()
    # Whole windows only: zeros before the record would look like excitation.
    past = np.lib.stride_tricks.sliding_window_view(u, largest)
    eigenvalues = np.linalg.eigvalsh(past.T @ past)
    return int(np.count_nonzero(eigenvalues > EXCITED * eigenvalues[-1]))
