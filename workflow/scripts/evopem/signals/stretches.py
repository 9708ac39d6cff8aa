"""Stretches: consecutive samples of recordings, each with an initial state of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stretch:
    """Consecutive samples of one recording.

    Attributes
    ----------
    input, output : (N,) arrays
    recording : int
        Number of the recording, from 0.  Stretches of one recording share their level; each stretch
        has its own initial state.
    """

    input: Array
    output: Array
    recording: int = 0

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return int(self.output.size)


def total_samples(stretches: Sequence[Stretch]) -> int:
    """Samples of all stretches together."""
    return sum(each.samples for each in stretches)
