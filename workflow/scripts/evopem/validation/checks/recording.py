"""Check of the recording."""

from __future__ import annotations

import math

from evopem.validation.checks.check import LISTED, Check, Evidence

# Percentage of the samples at a channel's limits above which the channel counts as saturated.
MAX_SATURATED_PERCENT = 0.1


def saturation(evidence: Evidence) -> Check:
    """No channel saturated: at its smallest or largest value for several samples."""
    name, recording = "Record not saturated", evidence.recording
    percent = {}
    for role, channels in (("input", recording.inputs), ("output", recording.outputs)):
        for channel in channels:
            called = role if len(channels) == 1 else f"{role} {channel.name}"
            percent[called] = channel.saturated_percent
    if any(math.isnan(each) for each in percent.values()):
        return Check(
            name,
            None,
            "The share of saturated samples could not be computed.",
            "Inspect the record.",
        )
    saturated = {channel: each for channel, each in percent.items() if each > MAX_SATURATED_PERCENT}
    if not saturated:
        return Check(name, True, "No channel stays at its smallest or largest value.")
    shares = [f"{each:.2g} % of the {channel}" for channel, each in saturated.items()]
    more = f" and {len(shares) - LISTED} more channels" if len(shares) > LISTED else ""
    return Check(
        name,
        False,
        f"{' and '.join(shares[:LISTED])}{more} is saturated: it stays at its smallest or largest"
        " value.",
        "A linear model does not describe saturation. Record again within the range of the"
        " instrument.",
    )
