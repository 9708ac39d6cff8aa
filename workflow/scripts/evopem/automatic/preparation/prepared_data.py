"""Prepared samples of the automatic recipe, in the form that all later stages read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.preparation.drift import differenced
from evopem.automatic.preparation.plan import PreparationPlan, means_of, stretches_of
from evopem.errors import InputError
from evopem.signals.prepared_data import PreparedData, Rows, StretchOrigin
from evopem.signals.recording import Recording, Segment
from evopem.signals.transforms import difference, invert_difference

Array = NDArray[np.float64]


def prepared_data(divided: PreparedData, plan: PreparationPlan, place: str) -> PreparedData:
    """The stretches of both parts as a plan prepares them, and the way back.

    `divided`: Both parts before the decisions; means are taken from them already.
    """
    before = divided.transforms
    offsets = means_of(
        [
            differenced(each.segment, plan.differences)
            for each in stretches_of(divided.estimation, plan)
        ]
    )
    estimation, origins = _part(divided.estimation, before.estimation, plan, offsets)
    others = plan.for_others(divided.validation)
    validation, held_out = _part(divided.validation, before.validation, others, offsets)
    for origin, whole in zip(before.validation, divided.validation.segments, strict=True):
        if origin.recording not in {each.recording for each in held_out}:
            raise InputError(
                f"{place}.split",
                f"{whole.samples} validation samples are too few",
                "leave more samples to validation, or record longer",
            )
    ends = [each.first + each.samples for each in before.estimation]
    continued = (
        plan.factor == 1
        and plan.differences == 0
        and [each.first + each.samples for each in origins] == ends
    )
    rate = estimation.sampling_rate
    recorded = before.resampled_from
    if rate != before.sampling_rate:
        recorded = recorded or before.sampling_rate
    source = before.validation_source
    transforms = replace(
        before,
        sampling_rate=rate,
        resampled_from=recorded,
        estimation=origins,
        validation=held_out,
        validation_source="gap" if source == "cut" and not continued else source,
        difference=before.difference + plan.differences,
        difference_input=before.difference_input + plan.differences,
    )
    return PreparedData(estimation, validation, transforms)


def _part(
    recording: Recording,
    before: Sequence[StretchOrigin],
    plan: PreparationPlan,
    offsets: tuple[Array, Array],
) -> tuple[Recording, tuple[StretchOrigin, ...]]:
    """The stretches of a part in recorded units, less their means, and where they come from."""
    rate = recording.sampling_rate / plan.factor
    segments, origins = [], []
    for place, begin, whole in stretches_of(recording, plan):
        origin, segment = before[place], recording.segments[place]
        stretch = differenced(whole, plan.differences)
        segments.append(
            Segment(stretch.inputs - offsets[0], stretch.outputs - offsets[1], origin.recording)
        )
        means = np.array(origin.input_means), np.array(origin.output_means)
        if plan.differences:  # no mean of the signals is left in them
            initial = [
                difference(signals + mean, plan.differences)[1]
                for signals, mean in zip((whole.inputs, whole.outputs), means, strict=True)
            ]
            means = np.zeros_like(means[0]), np.zeros_like(means[1])
        else:
            initial = [
                _later(segment.inputs + means[0], origin.input_initial, begin),
                _later(segment.outputs + means[1], origin.output_initial, begin),
            ]
        origins.append(
            StretchOrigin(
                origin.recording,
                (origin.first + begin) // plan.factor + plan.differences,
                origin.start + begin / recording.sampling_rate + plan.differences / rate,
                stretch.samples,
                tuple((means[0] + offsets[0]).tolist()),
                tuple((means[1] + offsets[1]).tolist()),
                *initial,
            )
        )
    if not segments:
        return recording, ()
    return replace(recording.with_segments(segments), sampling_rate=rate), tuple(origins)


def _later(signals: Array, initial: Rows, begin: int) -> Rows:
    """What differences start from, when their first ``begin`` samples are left out."""
    if begin == 0 or not initial:
        return initial
    return difference(invert_difference(signals, initial)[begin:], len(initial))[1]
