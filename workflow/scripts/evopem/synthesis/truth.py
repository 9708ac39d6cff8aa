"""The system behind a synthetic recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.models.modes import Mode
from evopem.models.structures import Orders

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Truth:
    """What a synthetic recording was made from."""

    kind: str  # flexible_arm or armax
    seed: int
    delay_samples: int  # from input to output
    modes: tuple[Mode, ...]
    noise: dict[str, float]  # levels of the disturbances, by their names
    box_cox: float | None  # the transform and the differences that the output was made for
    difference: int
    orders: Orders | None = None  # of an ARMAX model, and its coefficients
    a: Array | None = None
    b: Array | None = None
    c: Array | None = None


def true_mode(frequency: float, damping_ratio: float, sampling_rate: float) -> Mode:
    """A mode of known natural frequency (Hz) and damping ratio, at a sampling rate in Hz."""
    omega = 2.0 * np.pi * frequency
    s = omega * complex(-damping_ratio, np.sqrt(1.0 - damping_ratio**2))
    return Mode(frequency, damping_ratio, complex(np.exp(s / sampling_rate)))
