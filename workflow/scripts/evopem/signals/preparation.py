"""From a recording to the samples a model is estimated and validated on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from evopem.config.settings import PreparationSettings
from evopem.errors import InputError
from evopem.signals.joining import check_independent, check_same_rate
from evopem.signals.output_level import output_levels
from evopem.signals.prepared_data import PreparedData, StretchOrigin, Transforms
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import check_recording
from evopem.signals.resampling import resample_recording
from evopem.signals.sections import (
    Range,
    check_differences,
    divided_ranges,
    prepared_samples,
    transform_outputs,
)
from evopem.signals.transforms import difference

Levels = tuple[tuple[float, ...], tuple[float, ...]]
"""Means of the inputs and levels of the outputs."""


def prepare(
    recording: Recording,
    settings: PreparationSettings,
    validation_recording: Recording | None = None,
    place: str = "",
    recorded: Sequence[str] = (),
) -> PreparedData:
    """Make one or several recordings stationary, and divide them for estimation and validation.

    In this order: resample; Box-Cox transform of the output; differences of the outputs and
    of the inputs, the other signals losing their first samples so that all stay aligned;
    discard; cut; subtract the inputs' means and the outputs' levels in the estimation samples. A
    validation recording passes through the same transforms with the same parameters. An
    automatic Box-Cox parameter is found from the estimation samples alone.

    Several recordings are resampled and differenced each by itself, ``discard`` applies to each,
    and each is freed of its own means and levels. Without a validation recording the last
    recordings validate, or, with ``split.by`` of ``samples``, the last samples of each.

    `recording`: The measured signals, with one segment for each recording; not modified.
    `settings`: With a validation recording, ``split.estimation`` of 1.0 takes all samples.
    `validation_recording`: One or several independent recordings to validate on.
    """
    key = f"{place}." if place else ""
    given = recording.separated
    others = () if validation_recording is None else validation_recording.separated
    if validation_recording is not None:
        _check_validation(recording, validation_recording, f"{key}validation_file")
    records = [*given, *others]
    if settings.resample is not None:
        records = [
            resample_recording(each, settings.resample, f"{key}resample") for each in records
        ]
    transforms = settings.transforms
    check_differences(transforms, f"{key}transforms")
    counts = (transforms.difference, transforms.difference_input)
    ranges = divided_ranges(records, len(given), settings.split, max(counts), f"{key}split")
    records, parameter, shift = transform_outputs(
        records, transforms.box_cox, ranges.estimation, f"{key}transforms.box_cox"
    )
    alone = len(given) == 1 and len(others) <= 1
    levels: dict[int, Levels] = {}

    def sections(part: str) -> tuple[Recording, tuple[StretchOrigin, ...]]:
        found = [_section(records, each, counts, levels, alone) for each in ranges.of(part)]
        for each, origin in found:
            called = prepared_samples(f"{key}{part}", recorded, origin.recording)
            check_recording(each, called, alone and part == "validation")
        segments = [replace(each.segments[0], recording=origin.recording) for each, origin in found]
        return found[0][0].with_segments(segments), tuple(origin for _, origin in found)

    estimation, origins = sections("estimation")
    validation, held_out = sections("validation")
    rates = estimation.sampling_rate, recording.sampling_rate
    return PreparedData(
        estimation,
        validation,
        Transforms(
            sampling_rate=rates[0],
            resampled_from=rates[1] if rates[0] != rates[1] else None,
            estimation=origins,
            validation=held_out,
            validation_source=ranges.source,
            box_cox=parameter,
            shift=shift,
            difference=counts[0],
            difference_input=counts[1],
        ),
    )


def _check_validation(recording: Recording, validation: Recording, place: str) -> None:
    """Refuse a validation recording of another rate, of other channels, or of the same samples."""
    check_same_rate(recording, validation, place)
    for role in ("input", "output"):
        expected, given = (len(getattr(each, f"{role}_names")) for each in (recording, validation))
        if given != expected:
            raise InputError(
                place,
                f"it has {given} {role}s and the estimation recording {expected}",
                "validate on a recording of the same channels",
            )
    check_independent(recording, validation, place)


def _section(
    records: Sequence[Recording],
    samples: Range,
    counts: tuple[int, int],
    levels: dict[int, Levels],
    alone: bool,
) -> tuple[Recording, StretchOrigin]:
    """Differenced samples less the means and levels of their recording, or of the estimation ones.

    Those are of the first samples of it that are asked for. The differences begin as many samples
    before the first as they cost, so that inputs and outputs stay aligned.
    """
    number, first, stop = samples
    record = records[number]
    outputs, output_initial = difference(record.outputs[first - counts[0] : stop], counts[0])
    inputs, input_initial = difference(record.inputs[first - counts[1] : stop], counts[1])
    section = replace(record, inputs=inputs, outputs=outputs)
    known = 0 if alone else number
    if known not in levels:
        levels[known] = tuple(inputs.mean(axis=0).tolist()), output_levels(section)
    means = levels[known]
    origin = StretchOrigin(
        *(number, first, first / record.sampling_rate, len(outputs)),
        *(*means, input_initial, output_initial),
    )
    return replace(section, inputs=inputs - means[0], outputs=outputs - means[1]), origin
