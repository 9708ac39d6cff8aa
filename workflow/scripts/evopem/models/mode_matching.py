"""Pairing of estimated modes with those of a reference."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from evopem.models.modes import Mode

# Modes whose natural frequencies differ by more than this share are not the same mode.
SAME_MODE = 0.15


def match_modes(estimates: Sequence[Mode], references: Sequence[Mode]) -> dict[int, int]:
    """Pair modes by natural frequency, each at most once.

    As many modes as possible are paired, with the least sum of squared distances in the logarithm
    of frequency (an assignment problem). Modes further apart than :data:`SAME_MODE` are not paired.

    Returns
    -------
    dict of int to int
        Index of the reference, by index of the estimate.

    Examples
    --------
    >>> found = [Mode(5.4, 0.01, 0j), Mode(21.0, 0.1, 0j), Mode(37.1, 0.01, 0j)]
    >>> match_modes(found, [Mode(5.36, 0.01, 0j), Mode(37.0, 0.01, 0j)])
    {0: 0, 2: 1}
    """
    from scipy.optimize import linear_sum_assignment

    if not estimates or not references:
        return {}
    distance = np.abs(
        np.subtract.outer(
            [math.log(mode.frequency_hz) for mode in estimates],
            [math.log(mode.frequency_hz) for mode in references],
        )
    )
    # Pairs that are too far apart all have one large cost, so that none displaces a good pair.
    limit = math.log(1 + SAME_MODE)
    rows, columns = linear_sum_assignment(np.where(distance <= limit, distance**2, 1e3))
    return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if distance[r, c] <= limit}


def frequency_deviation(estimate: Mode, truth: Mode) -> float:
    """Estimate minus truth of the natural frequency, in standard errors of the estimate.

    NaN where the standard error is not known, not finite or zero.
    """
    return _deviation(estimate.frequency_hz - truth.frequency_hz, estimate.frequency_se_hz)


def damping_deviation(estimate: Mode, truth: Mode) -> float:
    """Estimate minus truth of the damping ratio, in standard errors of the estimate.

    NaN where the standard error is not known, not finite or zero.
    """
    return _deviation(estimate.damping_ratio - truth.damping_ratio, estimate.damping_se)


def _deviation(difference: float, error: float) -> float:
    return difference / error if math.isfinite(error) and error > 0.0 else math.nan
