"""Time stamps of even samples from a clock that is coarser than their steps show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SPREAD = 0.1
"""Ticks of one clock may differ by this share of a tick, as 15 and 16 ms do of one of 15.6 ms."""
KNOWN = 0.01
"""Largest relative error of a rate that stamps of a coarse clock may leave."""
FEWEST, SMALLEST_SHARE = 10, 0.1
"""Steps of each length, and their share, from which on they are no repeated or lost samples."""
_HALVINGS = 60
"""Of the interval in which the step is searched; as many as a double has digits."""


@dataclass(frozen=True)
class CoarseClock:
    """A clock whose ticks are all that keeps the stamps of even samples from being even."""

    tick: float  # resolution of the clock, in the unit of the stamps
    step: float  # of the even times from which every stamp is less than a tick away
    relative_error: float  # the step is known to this share of itself: a tick over the whole time


def coarse_clock(times: NDArray[np.float64]) -> CoarseClock | None:
    """The clock of time stamps that are even but for its resolution; None where there is none.

    Stamps of even samples, cut or rounded to the ticks of a clock, have steps of two lengths, one
    tick apart: 0 and 10 ms where samples 3 ms apart are stamped by a clock of 10 ms, 3 and 4 ms
    where samples 3.3 ms apart are stamped in milliseconds. They all lie in a band one tick wide
    around even times. Samples that are lost or repeated irregularly leave that band. Regular ones
    would not, so that a tick of more than half the usual step has to show in many steps.

    ``times``, (N,), begin with 0.
    """
    steps = np.diff(times)
    shortest, longest = float(steps.min(initial=np.inf)), float(steps.max(initial=0.0))
    if steps.size < 2 or shortest < 0.0 or shortest == longest:
        return None
    long = steps > 0.5 * (shortest + longest)
    tick = float(np.median(steps[long]) - np.median(steps[~long]))
    spread = max(float(np.ptp(steps[long])), float(np.ptp(steps[~long])))
    if spread > SPREAD * tick:
        return None
    usual, rare = float(np.median(steps)), min(int(long.sum()), int((~long).sum()))
    if 0.0 < usual < 2.0 * tick and rare < max(FEWEST, SMALLEST_SHARE * steps.size):
        return None
    step, width = _narrowest_band(times, longest)
    error = tick / float(times[-1])
    if width > (1.0 + SPREAD) * tick or error > KNOWN:
        return None
    return CoarseClock(tick, step, error)


def _narrowest_band(times: NDArray[np.float64], longest: float) -> tuple[float, float]:
    """The step of the even times with the smallest spread of stamps around them, and the spread.

    The spread is a convex function of the step: its slope tells on which side the smallest lies.
    """
    numbers = np.arange(times.size, dtype=np.float64)
    low, high = 0.0, longest
    for _ in range(_HALVINGS):
        step = 0.5 * (low + high)
        off = times - step * numbers
        if np.argmax(off) > np.argmin(off):
            low = step
        else:
            high = step
    off = times - step * numbers
    return step, float(off.max() - off.min())
