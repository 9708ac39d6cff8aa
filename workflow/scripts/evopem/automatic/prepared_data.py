"""Prepared samples of the automatic recipe, in the form that all later stages read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decimation import decimated_stretch
from evopem.automatic.drift import differenced
from evopem.automatic.preparation import PreparationPlan, kept_ranges
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
    estimation, origins = _part(divided.estimation, before.estimation, plan)
    others = plan.for_others(divided.validation)
    validation, held_out = _part(divided.validation, before.validation, others)
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
    recording: Recording, before: Sequence[StretchOrigin], plan: PreparationPlan
) -> tuple[Recording, tuple[StretchOrigin, ...]]:
    """The stretches of a part in recorded units, less their means, and where they come from."""
    rate = recording.sampling_rate
    segments, origins = [], []
    for segment, start, origin in zip(recording.segments, plan.starts, before, strict=True):
        for begin, end in kept_ranges(segment, start, plan):
            whole = decimated_stretch(segment.between(begin, end), plan.factor)
            stretch = plan.without_offsets(differenced(whole, plan.differences))
            segments.append(replace(stretch, recording=origin.recording))
            origins.append(
                replace(
                    _means_and_initial(segment, whole, begin, origin, plan),
                    first=(origin.first + begin) // plan.factor + plan.differences,
                    start=origin.start + begin / rate + plan.differences * plan.factor / rate,
                    samples=stretch.samples,
                )
            )
    if not segments:
        return recording, ()
    prepared = replace(recording.with_segments(segments), sampling_rate=rate / plan.factor)
    return prepared, tuple(origins)


def _means_and_initial(
    segment: Segment, whole: Segment, begin: int, origin: StretchOrigin, plan: PreparationPlan
) -> StretchOrigin:
    """What was taken from a stretch, which is ``whole`` before the differences of a plan.

    It begins with sample ``begin`` of the segment.
    """
    offsets = np.array(plan.input_offsets), np.array(plan.output_offsets)
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
    return replace(
        origin,
        input_means=tuple((means[0] + offsets[0]).tolist()),
        output_means=tuple((means[1] + offsets[1]).tolist()),
        input_initial=initial[0],
        output_initial=initial[1],
    )


def _later(signals: Array, initial: Rows, begin: int) -> Rows:
    """What differences start from, when their first ``begin`` samples are left out."""
    if begin == 0 or not initial:
        return initial
    return difference(invert_difference(signals, initial)[begin:], len(initial))[1]
