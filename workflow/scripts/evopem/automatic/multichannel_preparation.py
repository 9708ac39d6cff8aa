"""Preparation of a recording of several channels, decided: start and decimation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Alternative, Decision, given_by_configuration, lowest
from evopem.automatic.preparation import (
    FACTORS,
    KEPT_REST,
    LEAST_GAIN,
    LEAST_SAMPLES,
    MOST_DECIMATED,
    MOST_FACTORS,
    OVERSAMPLED,
    POWER_SHARE,
    coherence_edge,
    decimated,
    power_edge,
    smoothed,
)
from evopem.estimation.state_space.estimate import sweep_state_space_orders
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.signals.multichannel import MultichannelRecording
from evopem.signals.multichannel_preparation import MultichannelData
from evopem.signals.stretches import Stretch

Array = NDArray[np.float64]

# Orders of the output-error models whose simulations of held-out samples compare factors.
PROBES = (2, 4, 6)
CRITERION = "simulation error on held-out samples at the recorded rate, % of the outputs"


@dataclass(frozen=True)
class MultichannelPlan:
    """What is done to the samples, before anything is estimated.

    Attributes
    ----------
    start : int
        First estimation sample kept.
    factor : int
        Decimation factor.
    decisions : tuple of Decision
    """

    start: int
    factor: int
    decisions: tuple[Decision, ...]


def decide_multichannel_preparation(
    estimation: MultichannelRecording, start_given: bool, rate_given: bool
) -> MultichannelPlan:
    """Decide where the estimation samples begin, and by which factor all are decimated.

    Parameters
    ----------
    estimation : MultichannelRecording
    start_given, rate_given : bool
        Whether the configuration says so itself.
    """
    if start_given:
        start, about_start = 0, given_by_configuration("start", "0")
    else:
        start, about_start = _decide_start(estimation)
    kept = estimation.between(start, estimation.samples)
    if rate_given:
        factor, about_factor = 1, given_by_configuration("decimation", "1")
    else:
        factor, about_factor = _decide_decimation(kept.between(0, MOST_DECIMATED))
    return MultichannelPlan(start, factor, (about_start, about_factor))


def apply_multichannel_plan(data: MultichannelData, plan: MultichannelPlan) -> MultichannelData:
    """Leave out the first estimation samples and decimate both parts."""
    estimation = data.estimation.between(plan.start, data.estimation.samples)
    parts = [_decimated(each, plan.factor) for each in (estimation, data.validation)]
    before = data.transforms
    input_means, output_means = parts[0].inputs.mean(axis=0), parts[0].outputs.mean(axis=0)
    centred = [
        replace(each, inputs=each.inputs - input_means, outputs=each.outputs - output_means)
        for each in parts
    ]
    transforms = replace(
        before,
        sampling_rate=parts[0].sampling_rate,
        decimation=plan.factor,
        input_means=_sums(before.input_means, input_means),
        output_means=_sums(before.output_means, output_means),
        discard=before.discard + plan.start,
        estimation_samples=centred[0].samples,
        validation_samples=centred[1].samples,
    )
    return MultichannelData(centred[0], centred[1], transforms)


def _sums(means: tuple[float, ...], further: Array) -> tuple[float, ...]:
    return tuple(float(one + other) for one, other in zip(means, further, strict=True))


def _decimated(recording: MultichannelRecording, factor: int) -> MultichannelRecording:
    """Every channel through the same zero-phase filter."""
    if factor == 1:
        return recording

    def lower(signals: Array) -> Array:
        columns = [decimated(signal, factor) for signal in signals.T]
        return np.column_stack(columns) if columns else signals[::factor]

    return replace(
        recording,
        inputs=lower(recording.inputs),
        outputs=lower(recording.outputs),
        sampling_rate=recording.sampling_rate / factor,
    )


def _decide_start(estimation: MultichannelRecording) -> tuple[int, Decision]:
    """Leave out leading samples in which no channel has begun to change."""
    signals = np.column_stack([estimation.inputs, estimation.outputs])
    changed = np.any(signals != signals[0], axis=1)
    start = max(int(np.argmax(changed)) - KEPT_REST, 0)
    sentence = (
        "Samples before the first change of any channel are left out."
        if start
        else "The record begins with its first sample; the transient belongs to the estimated "
        "initial state."
    )
    alternatives = [Alternative("0", 0.0)] + (
        [Alternative(str(start), float(start))] if start else []
    )
    criterion = "leading samples without any change"
    return start, Decision("start", str(start), tuple(alternatives), criterion, sentence)


def _decide_decimation(estimation: MultichannelRecording) -> tuple[int, Decision]:
    """Decimation by the error of simulations on held-out samples, at the recorded rate."""
    edge = max(power_edge([Stretch(output, output)]) for output in _columns(estimation.outputs))
    largest = 1.0 / (OVERSAMPLED / 2.0 * max(edge, 1e-9))
    factors = [f for f in FACTORS if f <= largest and estimation.samples / f >= LEAST_SAMPLES]
    if not factors:
        return _not_decimated(
            f"{100 * POWER_SHARE:g} % of the power of every output are only reached at {edge:.3g} "
            "of the sampling rate: the record is not oversampled."
        )
    if not estimation.has_input:
        return _not_decimated("Without an input the rate is kept: nothing tells modes from noise.")
    coherent = max(
        coherence_edge([Stretch(input_, output)])
        for input_ in _columns(estimation.inputs)
        for output in _columns(estimation.outputs)
    )
    factors = [f for f in factors if f * coherent <= 0.5][-MOST_FACTORS:]
    if not factors:
        return _not_decimated(
            f"An input and an output are coherent up to {coherent:.3g} of the sampling rate, though"
            f" {100 * POWER_SHARE:g} % of the power of every output lie below {edge:.3g} of it: a"
            " lower rate would lose dynamics."
        )
    alternatives = [
        Alternative(str(factor), _simulation_error(estimation, factor)) for factor in (1, *factors)
    ]
    chosen = lowest(alternatives, LEAST_GAIN)
    sentence = (
        f"{100 * POWER_SHARE:g} % of the power of every output lie below {edge:.3g} of the sampling"
        f" rate. A factor of {chosen.name} simulates held-out samples best."
    )
    return int(chosen.name), Decision(
        "decimation", chosen.name, tuple(alternatives), CRITERION, sentence
    )


def _not_decimated(sentence: str) -> tuple[int, Decision]:
    return 1, Decision("decimation", "1", (Alternative("1", np.nan),), CRITERION, sentence)


def _columns(signals: Array) -> list[Array]:
    return [np.ascontiguousarray(column) for column in signals.T]


def _simulation_error(estimation: MultichannelRecording, factor: int) -> float:
    """Best two-fold error over a few orders at a lower rate; what the filter takes is added."""
    lower = _decimated(estimation, factor)
    lost = np.array([np.sum((y - smoothed(y, factor)) ** 2) for y in _columns(estimation.outputs)])
    total = np.sum((estimation.outputs - estimation.outputs.mean(axis=0)) ** 2, axis=0)
    found = sweep_state_space_orders(
        lower.inputs,
        lower.outputs,
        PROBES,
        form="output_error",
        delays=0,
        settings=StateSpaceSettings(weighting="power"),
    )
    best = float(np.min(found.simulation_error)) / 100.0
    return 100.0 * float(np.sqrt(best**2 + np.mean(lost / total)))
