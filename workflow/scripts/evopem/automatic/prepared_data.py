"""Prepared samples of the automatic recipe, in the form that all later stages read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.preparation import (
    PreparationPlan,
    PreparedRecord,
    prepare,
    prepare_validation,
    ranges_between_breaks,
    undifferenced,
)
from evopem.automatic.stretches import Stretch
from evopem.errors import InputError
from evopem.files.npz import load_arrays, save_arrays
from evopem.signals.preparation import PreparedData, Transforms
from evopem.signals.recording import Recording
from evopem.signals.transforms import difference, invert_difference

Array = NDArray[np.float64]


def prepared_data(divided: PreparedData, record: PreparedRecord, place: str) -> PreparedData:
    """The longest stretch of the estimation samples, the validation samples, and the way back.

    Parameters
    ----------
    divided : PreparedData
        Both parts before the decisions; means are taken from them already.
    record : PreparedRecord
        The stretches of its estimation samples.
    place : str
        Configuration key of the data set, for an error to name.

    Raises
    ------
    InputError
        When too few validation samples are left.
    """
    plan, before = record.plan, divided.transforms
    held_out = prepare_validation(divided.validation, plan)
    if not held_out:
        raise InputError(
            f"{place}.split",
            f"{divided.validation.samples} validation samples are too few",
            "leave more samples to validation, or record longer",
        )
    estimation = max(record.stretches, key=lambda each: each.samples)
    validation = max(held_out, key=lambda each: each.samples)
    begin = _begin_of_longest(divided.estimation, plan)
    follows = (
        plan.factor == 1
        and plan.differences == 0
        and begin + estimation.samples == divided.estimation.samples
    )
    source = (
        "gap" if before.validation_source == "cut" and not follows else before.validation_source
    )
    rate = record.sampling_rate
    changed = rate != divided.estimation.sampling_rate
    if plan.differences:
        before = _differenced(before, divided, plan)
    transforms = replace(
        before,
        sampling_rate=rate,
        resampled_from=before.resampled_from or before.sampling_rate
        if changed
        else before.resampled_from,
        input_mean=before.input_mean + plan.input_offset,
        output_mean=before.output_mean + plan.output_offset,
        difference_initial=before.difference_initial
        if plan.differences
        else _initial(
            divided.estimation.output + before.output_mean, before.difference_initial, begin
        ),
        difference_input_initial=before.difference_input_initial
        if plan.differences
        else _initial(
            divided.estimation.input + before.input_mean, before.difference_input_initial, begin
        ),
        discard=before.discard + begin,
        estimation_samples=estimation.samples,
        validation_samples=validation.samples,
        validation_source=source,
    )
    return PreparedData(
        _recording(divided.estimation, estimation, plan, rate),
        _recording(divided.validation, validation, plan, rate),
        transforms,
    )


def save_stretches(stretches: Sequence[Stretch], path: str | Path) -> None:
    """Write stretches one after the other, with their lengths and recordings."""
    arrays = {
        "input": np.concatenate([each.input for each in stretches]),
        "output": np.concatenate([each.output for each in stretches]),
        "samples": np.array([each.samples for each in stretches]),
        "recording": np.array([each.recording for each in stretches]),
    }
    save_arrays(path, arrays)


def load_stretches(path: str | Path) -> tuple[Stretch, ...]:
    """Read what :func:`save_stretches` wrote.

    Raises
    ------
    InputError
        When the file is missing or damaged.
    """
    stored = load_arrays(path, ("input", "output", "samples", "recording"))
    ends = np.cumsum(stored["samples"])[:-1]
    parts = zip(np.split(stored["input"], ends), np.split(stored["output"], ends), strict=True)
    return tuple(
        Stretch(u.copy(), y.copy(), int(number))
        for (u, y), number in zip(parts, stored["recording"], strict=True)
    )


def _begin_of_longest(recording: Recording, plan: PreparationPlan) -> int:
    """First sample of the longest stretch, before decimation."""
    ranges = ranges_between_breaks(recording, plan.starts[0], plan)
    return max(ranges, key=lambda each: each[1] - each[0])[0]


def _differenced(before: Transforms, divided: PreparedData, plan: PreparationPlan) -> Transforms:
    """The transforms with the differences of a plan, which have no mean of the signals."""
    times = plan.differences
    whole = replace(undifferenced(plan), input_scale=1.0, output_scale=1.0)
    estimation, validation = (
        max(stretches, key=lambda each: each.samples)
        for stretches in (
            prepare((divided.estimation,), whole).stretches,
            prepare_validation(divided.validation, whole),
        )
    )

    def initial(signal: Array, mean: float) -> tuple[float, ...]:
        return difference(signal + mean, times)[1]

    return replace(
        before,
        difference=times,
        difference_input=times,
        difference_initial=initial(estimation.output, before.output_mean),
        difference_input_initial=initial(estimation.input, before.input_mean),
        validation_difference_initial=initial(validation.output, before.output_mean),
        validation_difference_input_initial=initial(validation.input, before.input_mean),
        input_mean=0.0,
        output_mean=0.0,
    )


def _initial(signal: Array, initial: tuple[float, ...], begin: int) -> tuple[float, ...]:
    """What differences start from, when their first ``begin`` samples are left out."""
    if begin == 0 or not initial:
        return initial
    return difference(invert_difference(signal, initial)[begin:], len(initial))[1]


def _recording(
    before: Recording, stretch: Stretch, plan: PreparationPlan, rate: float
) -> Recording:
    return replace(
        before,
        input=stretch.input * plan.input_scale,
        output=stretch.output * plan.output_scale,
        sampling_rate=rate,
    )
