"""Whether a mode can be trusted: reasons to doubt it, from what the data say about it."""

from __future__ import annotations

import math
from typing import Protocol

from evopem.models.modes import Mode

# Damping ratio above which a pair of poles is hardly a resonance.
STRONG_DAMPING = 0.5
# Largest half width of the 95 % interval of a frequency, relative to the frequency.
WIDEST_INTERVAL = 0.1
# Decay in a sample, relative to the amplitude, that no record of usual length shows.
NO_DECAY = 1e-6
# Level of the test that tells two poles apart, and smallest assurance (MAC) that a known shape is
# expected to have with the true one: that of well correlated shapes (Ewins 2000).
POLES_APART, KNOWN_SHAPE = 0.01, 0.9


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
    if 2.0 * math.pi * mode.damping_ratio * mode.frequency_hz <= NO_DECAY * sampling_rate:
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
        share = f"only {100 * evidence.recurrence:.0f} %" if evidence.recurrence else "none"
        found.append(f"was found at {share} of the orders compared")
    half_width = 1.96 * mode.frequency_se_hz
    if not math.isfinite(half_width):
        found.append("has no known standard error")
    elif half_width > WIDEST_INTERVAL * mode.frequency_hz:
        found.append("has a frequency known to no better than 10 %")
    return found


def shape_doubt(mode: Mode) -> str:
    """Reason to doubt a mode's shape though not its frequency and damping; empty for none.

    Shapes of poles that the data do not tell apart may be any mixture of each other.

    Parameters
    ----------
    mode : Mode
    """
    if len(mode.shape) < 2 or not math.isfinite(mode.shape_assurance):
        return ""
    if mode.equal_poles_p > POLES_APART:
        return "the data do not tell its pole from a neighbour’s, so that the shapes may be mixed"
    if mode.shape_assurance < KNOWN_SHAPE:
        return f"a MAC of only {mode.shape_assurance:.2f} is expected with the true shape"
    return ""


def plane_is_known(mode: Mode, partner: Mode) -> bool:
    """Whether two shapes that may be mixed lie in one plane that the data determine.

    The statement is empty below three outputs, which have one plane alone.

    Parameters
    ----------
    mode, partner : Mode
        Of one model.
    """
    mixed = len(mode.shape) > 2 and mode.equal_poles_p > POLES_APART
    return mixed and min(mode.plane_assurance, partner.plane_assurance) >= KNOWN_SHAPE
