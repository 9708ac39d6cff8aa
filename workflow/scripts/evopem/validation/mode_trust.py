"""Whether a mode can be trusted: reasons to doubt it, from what the data say about it."""

from __future__ import annotations

import math
from typing import Protocol

# Damping ratio above which a pair of poles is hardly a resonance.
STRONG_DAMPING = 0.5
# Largest half width of the 95 % interval of a frequency, relative to the frequency.
WIDEST_INTERVAL = 0.1


class EstimatedMode(Protocol):
    """A mode of a model with one output or several."""

    @property
    def frequency_hz(self) -> float:
        """Undamped natural frequency."""
        ...

    @property
    def damping_ratio(self) -> float:
        """Damping ratio."""
        ...

    @property
    def frequency_se_hz(self) -> float:
        """Standard error of the frequency."""
        ...


class Evidence(Protocol):
    """What the data say about a mode; see :class:`.mode_evidence.ModeEvidence`."""

    @property
    def mode(self) -> EstimatedMode:
        """The mode."""
        ...

    @property
    def has_input(self) -> bool:
        """Whether its model has an input."""
        ...

    @property
    def origin(self) -> str:
        """What drives it."""
        ...

    @property
    def recurrence(self) -> float:
        """Share of the other orders that have it."""
        ...

    @property
    def stable(self) -> bool | None:
        """Whether that share is large enough."""
        ...


def doubts(evidence: Evidence, sampling_rate: float) -> list[str]:
    """Reasons to doubt a mode, each a predicate such as "decays too fast to be a resonance".

    A mode is trusted when there is none: it is an underdamped resonance below half the sampling
    rate, the input drives it or the noise model needs it on held-out samples, three quarters of the
    models of other orders have it, and its frequency is known to within 10 %.

    Parameters
    ----------
    evidence : ModeEvidence or JudgedMode
    sampling_rate : float
        Hz.
    """
    mode, found = evidence.mode, []
    if mode.damping_ratio > STRONG_DAMPING or mode.frequency_hz > sampling_rate / 2:
        found.append("decays too fast to be a resonance")
    if mode.damping_ratio <= 0:
        found.append("does not decay")
    if evidence.origin == "neither":
        found.append(
            "shows neither in the response to the input nor in the noise"
            if evidence.has_input
            else "does not improve the prediction of validation samples"
        )
    elif evidence.origin == "not judged":
        found.append("could not be tested on validation samples")
    if evidence.stable is False:
        found.append(f"was found at only {100 * evidence.recurrence:.0f} % of the orders compared")
    half_width = 1.96 * mode.frequency_se_hz
    if not math.isfinite(half_width):
        found.append("has no known standard error")
    elif half_width > WIDEST_INTERVAL * mode.frequency_hz:
        found.append("has a frequency known to no better than 10 %")
    return found
