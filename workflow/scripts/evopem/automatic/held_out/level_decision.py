"""Whether the level of other samples is that of the estimation samples, or a state of their own."""

from __future__ import annotations

from typing import Literal

from evopem.automatic.decision import Alternative, Decision

Level = Literal["constant", "state"]


def decide_level(constant: float, free: float, clear_gain: float = 0.0) -> tuple[Level, Decision]:
    """Decide by the lowest simulation errors on held-out samples.

    The errors, in percent, are those with the level of the estimation samples, and with one fitted
    to the held-out samples along with the initial state, which is taken from a relative gain of
    ``clear_gain`` on.
    """
    level: Level = "state" if free < (1.0 - clear_gain) * constant else "constant"
    sentence = (
        "The level drifts: held-out samples are simulated better when their level is fitted to "
        "them with the initial state."
        if level == "state"
        else "The level of the estimation samples holds for held-out samples as well."
    )
    alternatives = (Alternative("constant", constant), Alternative("state", free))
    criterion = "lowest simulation error on held-out samples, %"
    return level, Decision("level", level, alternatives, criterion, sentence)
