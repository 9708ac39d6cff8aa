"""The delays of the inputs of a record, decided by vector ARX models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evopem.automatic.decision import Alternative, Decision, given_by_configuration
from evopem.config.input_ranges import InputRanges
from evopem.estimation.state_space.delays import estimate_delays
from evopem.signals.multichannel import MultichannelRecording

LARGEST_DELAY = 10


@dataclass(frozen=True)
class DelayChoice:
    """Delays of the inputs in samples, 0 for one that acts on the same sample."""

    delays: tuple[int, ...]
    decision: Decision


def decide_delays(
    estimation: MultichannelRecording, ranges: InputRanges | None = None
) -> DelayChoice:
    """Decide the delay of each input by the BIC of vector ARX models.

    Parameters
    ----------
    estimation : MultichannelRecording
    ranges : InputRanges, optional

    Raises
    ------
    InputError
        When the ranges are those of other inputs.
    """
    ranges = ranges or InputRanges()
    given = ranges.of_inputs(estimation.input_names, "delay.nk") if estimation.has_input else ()
    limits = [each or (0, LARGEST_DELAY) for each in given]
    if all(low == high for low, high in limits):
        delays = tuple(low for low, _ in limits)
        return DelayChoice(delays, given_by_configuration("delays", _listed(delays) or "none"))
    smallest, largest = zip(*limits, strict=True)
    delays = estimate_delays(estimation.input_records, estimation.output_records, largest, smallest)
    alternatives = tuple(
        Alternative(f"{name}: {delay}", np.nan)
        for name, delay in zip(estimation.input_names, delays, strict=True)
    )
    return DelayChoice(
        delays,
        Decision(
            *("delays", _listed(delays), alternatives, "BIC of vector ARX models"),
            "The first lags of an input are left out as long as they explain nothing.",
        ),
    )


def _listed(delays: Sequence[int]) -> str:
    return ", ".join(map(str, delays))
