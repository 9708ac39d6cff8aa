"""The delays of the inputs of a recording, decided by the BIC of ARX models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from evopem.automatic.decision import Alternative, Decision, given_by_configuration
from evopem.automatic.held_out.stretches import MOST_SAMPLES, first_samples
from evopem.config.settings import InputRanges
from evopem.estimation.delays import ORDERS, delays_by_criterion, longest_delay
from evopem.signals.recording import Segment

# Alternatives of each input that are recorded.
RECORDED = 5


@dataclass(frozen=True)
class DelayChoice:
    """Delays of the inputs in samples, 0 for one that acts on the same sample."""

    delays: tuple[int, ...]
    decision: Decision


def decide_delays(
    segments: Sequence[Segment], names: Sequence[str], ranges: InputRanges | None = None
) -> DelayChoice:
    """Decide the delay of each input.

    Raises InputError when the ranges are those of other inputs.
    """
    segments = first_samples(segments, MOST_SAMPLES)
    given = (ranges or InputRanges()).of_inputs(names, "delay.nk") if names else ()
    limits = [each or (0, longest_delay(segments)) for each in given]
    if all(low == high for low, high in limits):
        delays = tuple(low for low, _ in limits)
        return DelayChoice(delays, given_by_configuration("delay", _listed(delays) or "none"))
    found = delays_by_criterion(segments, limits)
    delays = tuple(delay for delay, _ in found)
    several = len(names) > 1
    alternatives = tuple(
        Alternative(
            f"{name}: {low + place}" if several else str(low + place), float(criterion[place])
        )
        for name, (low, _), (_, criterion) in zip(names, limits, found, strict=True)
        for place in sorted(criterion.argsort()[:RECORDED].tolist())
    )
    sentence = (
        f"ARX models of up to order {ORDERS[-1]} have the smallest BIC with"
        f" {'a delay' if len(delays) == 1 else 'delays'} of {_listed(delays)}."
    )
    about = Decision("delay", _listed(delays), alternatives, "BIC of the best ARX model", sentence)
    return DelayChoice(delays, about)


def _listed(delays: Sequence[int]) -> str:
    return ", ".join(map(str, delays))
