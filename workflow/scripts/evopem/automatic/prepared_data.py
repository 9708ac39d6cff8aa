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
    kept_ranges,
    prepare,
    prepare_validation,
    undifferenced,
)
from evopem.errors import InputError
from evopem.files.npz import load_arrays, save_arrays
from evopem.signals.preparation import Part, PreparedData, StretchOrigin
from evopem.signals.recording import Recording, Segment
from evopem.signals.transforms import difference, invert_difference

Array = NDArray[np.float64]


def prepared_data(divided: PreparedData, record: PreparedRecord, place: str) -> PreparedData:
    """The stretches of the estimation samples, the validation samples, and the way back.

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
    held_out = _held_out(divided.validation, plan, place)
    begins = _begins(divided.estimation.separated, plan)
    follows = (
        plan.factor == 1
        and plan.differences == 0
        and len(begins) == 1
        and begins[0] + record.stretches[0].samples == divided.estimation.samples
    )
    source = (
        "gap" if before.validation_source == "cut" and not follows else before.validation_source
    )
    rate = record.sampling_rate
    changed = rate != divided.estimation.sampling_rate
    estimation = _prepared(divided.estimation, record.stretches, plan, rate)
    validation = _prepared(divided.validation, held_out, plan, rate)
    whole = replace(undifferenced(plan), input_scale=1.0, output_scale=1.0)
    levels = prepare(divided.estimation.separated, whole).stretches
    origins = _origins(divided, "estimation", record.stretches, begins, plan, levels)
    several = len(begins) > 1 or bool(before.estimation_stretches)
    levels_held_out = _held_out(divided.validation, whole, place)
    starts = [0] * len(held_out)
    of_held_out = _origins(divided, "validation", held_out, starts, plan, levels_held_out)
    if plan.differences:
        before = replace(
            before,
            difference=plan.differences,
            difference_input=plan.differences,
            validation_difference_initial=of_held_out[0].difference_initial,
            validation_difference_input_initial=of_held_out[0].difference_input_initial,
        )
    transforms = replace(
        before,
        sampling_rate=rate,
        resampled_from=before.resampled_from or before.sampling_rate
        if changed
        else before.resampled_from,
        input_mean=origins[0].input_mean,
        output_mean=origins[0].output_mean,
        difference_initial=origins[0].difference_initial,
        difference_input_initial=origins[0].difference_input_initial,
        discard=before.discard + begins[0],
        estimation_samples=estimation.samples,
        validation_samples=validation.samples,
        validation_source=source,
        estimation_stretches=origins if several else (),
        trend_start=before.trend_start + begins[0] / before.sampling_rate,
        validation_stretches=of_held_out if before.validation_stretches else (),
    )
    return PreparedData(estimation, validation, transforms)


def _held_out(validation: Recording, plan: PreparationPlan, place: str) -> list[Segment]:
    """The validation samples of each stretch, prepared."""
    found: list[Segment] = []
    for recording, number in zip(validation.separated, validation.segment_recordings, strict=True):
        prepared = prepare_validation(recording, plan)
        if not prepared:
            raise InputError(
                f"{place}.split",
                f"{recording.samples} validation samples are too few",
                "leave more samples to validation, or record longer",
            )
        found.extend(replace(each, recording=number) for each in prepared)
    return found


def _origins(
    divided: PreparedData,
    part: Part,
    stretches: Sequence[Segment],
    begins: Sequence[int],
    plan: PreparationPlan,
    levels: Sequence[Segment],
) -> tuple[StretchOrigin, ...]:
    """Where prepared stretches come from: each begins some samples after one of the part's own.

    Those of the estimation samples have the number of the stretch that they were a part of.
    ``levels`` are the same stretches before the differences of the plan.
    """
    recording = divided.estimation if part == "estimation" else divided.validation
    transforms, sources = divided.transforms.of_stretches(part), recording.segments
    known = (
        divided.transforms.estimation_stretches
        if part == "estimation"
        else divided.transforms.validation_stretches
    )
    origins = []
    listed = zip(stretches, begins, levels, strict=True)
    for position, (stretch, begin, level) in enumerate(listed):
        number = stretch.recording if part == "estimation" else position
        source, own = sources[number], transforms[number]
        first = known[number].first if known else divided.transforms.discard
        if plan.differences:  # which no mean of the signals is left in
            origins.append(
                StretchOrigin(
                    *(source.recording, (first + begin) // plan.factor, stretch.samples),
                    *(plan.input_offset, plan.output_offset),
                    difference(level.output + own.output_mean, plan.differences)[1],
                    difference(level.input + own.input_mean, plan.differences)[1],
                )
            )
            continue
        origins.append(
            StretchOrigin(
                recording=source.recording,
                first=(first + begin) // plan.factor,
                samples=stretch.samples,
                input_mean=own.input_mean + plan.input_offset,
                output_mean=own.output_mean + plan.output_offset,
                difference_initial=_initial(
                    source.output + own.output_mean, own.difference_initial, begin
                ),
                difference_input_initial=_initial(
                    source.input + own.input_mean, own.difference_input_initial, begin
                ),
            )
        )
    return tuple(origins)


def save_stretches(stretches: Sequence[Segment], path: str | Path) -> None:
    """Write stretches one after the other, with their lengths and recordings."""
    arrays = {
        "input": np.concatenate([each.input for each in stretches]),
        "output": np.concatenate([each.output for each in stretches]),
        "samples": np.array([each.samples for each in stretches]),
        "recording": np.array([each.recording for each in stretches]),
    }
    save_arrays(path, arrays)


def load_stretches(path: str | Path) -> tuple[Segment, ...]:
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
        Segment(u.copy(), y.copy(), int(number))
        for (u, y), number in zip(parts, stored["recording"], strict=True)
    )


def _begins(recordings: Sequence[Recording], plan: PreparationPlan) -> list[int]:
    """First sample of each stretch, in its recording before decimation."""
    return [
        begin
        for recording, start in zip(recordings, plan.starts, strict=True)
        for begin, _ in kept_ranges(recording, start, plan)
    ]


def _initial(signal: Array, initial: tuple[float, ...], begin: int) -> tuple[float, ...]:
    """What differences start from, when their first ``begin`` samples are left out."""
    if begin == 0 or not initial:
        return initial
    return difference(invert_difference(signal, initial)[begin:], len(initial))[1]


def _prepared(
    before: Recording, stretches: Sequence[Segment], plan: PreparationPlan, rate: float
) -> Recording:
    """Stretches in recorded units, less their offsets."""
    in_units = [
        replace(each, inputs=each.input * plan.input_scale, outputs=each.output * plan.output_scale)
        for each in stretches
    ]
    return replace(before.with_segments(in_units), sampling_rate=rate)
