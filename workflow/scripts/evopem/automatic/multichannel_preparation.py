"""Preparation of recordings of several channels, decided: start and decimation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.breaks import KEPT_REST
from evopem.automatic.decimation import (
    FACTORS,
    LEAST_SAMPLES,
    MOST_DECIMATED,
    MOST_FACTORS,
    OVERSAMPLED,
    POWER_SHARE,
    best_factor,
    coherence_edge,
    decimated,
    not_decimated,
    power_edge,
    smoothed,
)
from evopem.automatic.decision import Alternative, Decision, given_by_configuration
from evopem.estimation.state_space.held_out import two_fold_simulation_errors
from evopem.estimation.state_space.task import StateSpaceTask
from evopem.signals.multichannel_preparation import (
    SHORTEST_RECORD,
    MultichannelData,
    centred,
)
from evopem.signals.recording import Recording, Segment, concatenated

Array = NDArray[np.float64]

# Orders of the output-error models whose simulations of held-out samples compare factors.
PROBES = (2, 4, 6)
CRITERION = "simulation error on held-out samples at the recorded rate, % of the outputs"


@dataclass(frozen=True)
class MultichannelPlan:
    """What is done to the samples, before anything is estimated.

    Attributes
    ----------
    starts : tuple of int
        First estimation sample kept of each recording.
    factor : int
        Decimation factor.
    decisions : tuple of Decision
    """

    starts: tuple[int, ...]
    factor: int
    decisions: tuple[Decision, ...]


def decide_multichannel_preparation(
    estimation: Recording, start_given: bool, rate_given: bool
) -> MultichannelPlan:
    """Decide where the estimation samples begin, and by which factor all are decimated.

    Of several recordings each begins where its channels do.

    Parameters
    ----------
    estimation : Recording
    start_given, rate_given : bool
        Whether the configuration says so itself.
    """
    if start_given:
        starts, about_start = (
            (0,) * len(estimation.segment_starts),
            given_by_configuration("start", "0"),
        )
    else:
        starts, about_start = _decide_starts(estimation)
    if rate_given:
        factor, about_factor = 1, given_by_configuration("decimation", "1")
    else:
        kept = _from(estimation, starts)
        factor, about_factor = _decide_decimation(kept.first_samples(MOST_DECIMATED))
    return MultichannelPlan(starts, factor, (about_start, about_factor))


def apply_multichannel_plan(data: MultichannelData, plan: MultichannelPlan) -> MultichannelData:
    """Leave out the first estimation samples and decimate both parts."""
    estimation = _decimated(_from(data.estimation, plan.starts), plan.factor)
    before = data.transforms
    transforms = replace(
        before,
        decimation=plan.factor,
        discard=before.discard + plan.starts[0],
        estimation_records=tuple(
            replace(origin, first=origin.first + start)
            for origin, start in zip(before.estimation_records, plan.starts, strict=False)
        ),
    )
    return centred(estimation, _decimated(data.validation, plan.factor), transforms)


def _from(recording: Recording, starts: Sequence[int]) -> Recording:
    """Each record from a sample of its own on."""
    return concatenated(
        [
            each.between(start, each.samples)
            for each, start in zip(recording.separated, starts, strict=True)
        ]
    )


def _decimated(recording: Recording, factor: int) -> Recording:
    """Every channel of each record through the same zero-phase filter."""
    if factor == 1:
        return recording

    def lower(signals: Array) -> Array:
        columns = [decimated(signal, factor) for signal in signals.T]
        return np.column_stack(columns) if columns else signals[::factor]

    return concatenated(
        [
            replace(
                each,
                inputs=lower(each.inputs),
                outputs=lower(each.outputs),
                sampling_rate=each.sampling_rate / factor,
            )
            for each in recording.separated
        ]
    )


def _decide_starts(estimation: Recording) -> tuple[tuple[int, ...], Decision]:
    """Leave out leading samples in which no channel has begun to change."""
    starts = tuple(map(_first_change, estimation.separated))
    sentence = (
        "Samples before the first change of any channel are left out."
        if any(starts)
        else "The record begins with its first sample; the transient belongs to the estimated "
        "initial state."
    )
    alternatives = tuple(Alternative(str(start), float(start)) for start in sorted({0, *starts}))
    criterion = "leading samples without any change"
    return starts, Decision("start", ", ".join(map(str, starts)), alternatives, criterion, sentence)


def _first_change(record: Recording) -> int:
    """Leading samples of a record without any change, less those that tell the level of the rest.

    So many samples are kept as one of several recordings has at least.
    """
    signals = np.column_stack([record.inputs, record.outputs])
    changed = np.any(signals != signals[0], axis=1)
    most = max(record.samples - SHORTEST_RECORD, 0)
    return min(max(int(np.argmax(changed)) - KEPT_REST, 0), most)


def _decide_decimation(estimation: Recording) -> tuple[int, Decision]:
    """Decimation by the error of simulations on held-out samples, at the recorded rate."""
    longest = estimation.longest
    edge = max(power_edge([Segment(output, output)]) for output in _columns(longest.outputs))
    largest = 1.0 / (OVERSAMPLED / 2.0 * max(edge, 1e-9))
    shortest = min(each.samples for each in estimation.separated)
    factors = [
        f
        for f in FACTORS
        if f <= largest
        and estimation.samples / f >= LEAST_SAMPLES
        and shortest / f >= SHORTEST_RECORD
    ]
    if not factors:
        return not_decimated(
            f"{100 * POWER_SHARE:g} % of the power of every output are only reached at {edge:.3g} "
            "of the sampling rate: the record is not oversampled.",
            CRITERION,
        )
    if not estimation.has_input:
        return not_decimated(
            "Without an input the rate is kept: nothing tells modes from noise.", CRITERION
        )
    coherent = max(
        coherence_edge([Segment(input_, output)])
        for input_ in _columns(longest.inputs)
        for output in _columns(longest.outputs)
    )
    factors = [f for f in factors if f * coherent <= 0.5][-MOST_FACTORS:]
    if not factors:
        return not_decimated(
            f"An input and an output are coherent up to {coherent:.3g} of the sampling rate, though"
            f" {100 * POWER_SHARE:g} % of the power of every output lie below {edge:.3g} of it: a"
            " lower rate would lose dynamics.",
            CRITERION,
        )
    alternatives = [
        Alternative(str(factor), _simulation_error(estimation, factor)) for factor in (1, *factors)
    ]
    found = (
        f"{100 * POWER_SHARE:g} % of the power of every output lie below {edge:.3g} of the sampling"
        " rate."
    )
    return best_factor(alternatives, found, CRITERION)


def _columns(signals: Array) -> list[Array]:
    return [np.ascontiguousarray(column) for column in signals.T]


def _simulation_error(estimation: Recording, factor: int) -> float:
    """Best two-fold error over a few orders at a lower rate; what the filter takes is added."""
    lower = _decimated(estimation, factor)
    lost, total = np.sum([_lost_power(y, factor) for y in estimation.segment_outputs], axis=0)
    errors = two_fold_simulation_errors(
        lower, PROBES, StateSpaceTask("ss_oe", delays=0, weighting="power")
    )
    best = float(np.min(errors)) / 100.0
    return 100.0 * float(np.sqrt(best**2 + np.mean(lost / total)))


def _lost_power(outputs: Array, factor: int) -> Array:
    """Squares of what a lower rate takes from the outputs of a record, and of all, (2, ny)."""
    lost = [np.sum((y - smoothed(y, factor)) ** 2) for y in _columns(outputs)]
    return np.array([lost, np.sum((outputs - outputs.mean(axis=0)) ** 2, axis=0)])
