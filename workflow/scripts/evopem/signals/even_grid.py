"""Bringing signals with uneven time stamps to an even grid."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.coarse_clock import CoarseClock
from evopem.signals.timestamps import clock_of_uneven, elapsed, refuse_same_times, unit_of

LONGEST_GAP = 20
"""Steps between two stamps that are interpolated at most."""
MOST_IN_GAPS = 0.1
"""Largest share of the samples that may lie in gaps."""
GAP = 1.5
"""Two stamps farther apart than so many usual steps have a gap between them."""
BLOCKS, SHORTEST_BLOCK = 8, 25
"""Parts of the stamps whose mean steps are compared, and their smallest number of steps."""
LARGEST_CHANGE, SIGNIFICANT = 0.03, 6.0
"""Mean steps that differ by more than this share, and this many standard errors, are of two
rates."""
CLOSEST = 1e-6
"""Two stamps closer than this share of the usual step are the same time."""

Values = TypeVar("Values", bound=np.generic)


@dataclass(frozen=True)
class Unevenness:
    """How far time stamps are from even ones."""

    in_gaps: int  # missing samples: between stamps that are more than :data:`GAP` usual steps apart
    longest_gap: float  # largest distance of two neighbouring stamps, in steps
    largest_shift: float  # largest distance of a stamp from the nearest sample, in steps
    # resolution of a coarse clock whose stamps are otherwise even, in steps; 0.0 for others
    tick: float = 0.0


@dataclass(frozen=True, eq=False)
class EvenGrid:
    """An even grid from the first of uneven time stamps to the last."""

    step: float  # in the unit of the stamps, from the first one to the last a whole number of times
    samples: int
    unevenness: Unevenness
    stamps: NDArray[np.float64] = field(repr=False)  # (N,) the stamps, in steps from the first one

    def interpolated(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """A signal on the grid, linear between the two stamps around each sample."""
        return np.interp(np.arange(self.samples), self.stamps, values)


def coarseness(stamps: NDArray[Values], source: str, name: str) -> Unevenness | None:
    """How uneven a coarse clock makes the stamps of even samples; None for other stamps."""
    times = elapsed(stamps, source, name)
    clock = clock_of_uneven(times)
    return None if clock is None else _of_clock(clock, times)


def _of_clock(clock: CoarseClock, times: NDArray[np.float64]) -> Unevenness:
    tick = clock.tick / clock.step
    return Unevenness(0, float(np.diff(times).max()) / clock.step, tick, tick)


def even_grid(stamps: NDArray[Values], source: str, name: str) -> EvenGrid:
    """The grid of the usual step of time stamps, some of which may be late or missing.

    The stamps, (N,), are numbers, dates (datetime64) or durations (timedelta64), and increase.
    """
    times = elapsed(stamps, source, name)
    steps = np.diff(times)
    usual = float(np.median(steps))
    place = f'time "{name}"'
    clock = clock_of_uneven(times)
    if clock is not None:
        even = np.arange(times.size, dtype=np.float64)
        return EvenGrid(clock.step, times.size, _of_clock(clock, times), even)
    if steps.min() <= CLOSEST * usual:
        refuse_same_times(times, CLOSEST * usual, source, place, unit_of(stamps))
    _refuse_other_rate(steps, usual, source, place, unit_of(stamps))
    # The median of a few irregular steps is not exact enough to divide the whole time by.
    total = max(int(np.round(steps / usual).sum()), 1)
    step = float(times[-1]) / total
    on_grid = times / step
    gaps = steps > GAP * usual
    missing = int(np.sum(np.round(steps[gaps] / step) - 1))
    longest = float(steps.max() / step)
    if longest > LONGEST_GAP or missing > MOST_IN_GAPS * total:
        at = int(np.argmax(steps)) + 2
        raise InputError(
            source,
            f"{missing} samples of {total + 1} are missing, and the longest gap ends at this sample"
            f" after {longest:.3g} usual steps; up to {100 * MOST_IN_GAPS:g} % and {LONGEST_GAP}"
            " steps are interpolated",
            "give what was recorded without gaps, as several files of one data set",
            f"{place}, sample {at}",
        )
    shift = float(np.abs(on_grid - np.round(on_grid)).max())
    return EvenGrid(step, total + 1, Unevenness(missing, longest, shift), on_grid)


def _refuse_other_rate(
    steps: NDArray[np.float64], usual: float, source: str, place: str, unit: str
) -> None:
    """Refuse stamps whose mean step changes in the course of the recording.

    The steps that are missing in a gap are counted.  What jitter does to the mean step of a block
    follows from its steps.
    """
    blocks = min(BLOCKS, steps.size // SHORTEST_BLOCK)
    if blocks < 2:
        return
    edges = np.linspace(0, steps.size, blocks + 1).astype(int)
    medians = [float(np.median(each)) for each in np.split(steps, edges[1:-1])]
    counts = np.maximum(np.round(steps / np.repeat(medians, np.diff(edges))), 1.0)
    mean = np.add.reduceat(steps, edges[:-1]) / np.add.reduceat(counts, edges[:-1])
    off = steps - counts * np.repeat(mean, np.diff(edges))
    error = float(off.std()) * float(np.sqrt(2.0 / np.diff(edges).min()))
    low, high = int(np.argmin(mean)), int(np.argmax(mean))
    change = float(mean[high] - mean[low])
    if change > LARGEST_CHANGE * usual and change > SIGNIFICANT * error:
        first, last = sorted((low, high))
        raise InputError(
            source,
            f"the rate changes: the mean step is {mean[first]:.4g}{unit} from this sample on and"
            f" {mean[last]:.4g}{unit} from sample {edges[last] + 1} on",
            "give the parts of one rate as data sets of their own, or resample the recording",
            f"{place}, sample {edges[first] + 1}",
        )
