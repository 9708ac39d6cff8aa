"""Check of the recording."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from evopem.validation.checks.check import Check

if TYPE_CHECKING:
    from evopem.signals.recording_info import RecordingInfo

# Percentage of the samples at a channel's limits above which the channel counts as saturated.
MAX_SATURATED_PERCENT = 0.1


def saturation(recording: RecordingInfo) -> Check:
    """Neither channel saturated: at its smallest or largest value for several samples."""
    name = "Record not saturated"
    percent = {
        role: channel.saturated_percent
        for role, channels in (("input", recording.inputs), ("output", recording.outputs))
        for channel in channels
    }
    if any(math.isnan(each) for each in percent.values()):
        return Check(
            name,
            None,
            "The share of saturated samples could not be computed.",
            "Inspect the record.",
        )
    saturated = {channel: each for channel, each in percent.items() if each > MAX_SATURATED_PERCENT}
    if not saturated:
        return Check(name, True, "Neither channel stays at its smallest or largest value.")
    listed = " and ".join(f"{each:.2g} % of the {channel}" for channel, each in saturated.items())
    return Check(
        name,
        False,
        f"{listed} is saturated: it stays at its smallest or largest value.",
        "A linear model does not describe saturation. Record again within the range of the"
        " instrument.",
    )
