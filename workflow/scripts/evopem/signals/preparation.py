"""From a recording to the samples a model is estimated and validated on."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

import numpy as np

from evopem.arrays import Array
from evopem.config.settings import PreparationSettings, SplitSettings, TransformSettings
from evopem.errors import InputError
from evopem.signals.faulty_samples import LONG_STRETCH
from evopem.signals.prepared_data import PreparedData, Source, StretchOrigin, Transforms
from evopem.signals.recording import MINIMUM_SAMPLES, Recording, Segment
from evopem.signals.recording_checks import check_recording, check_validation
from evopem.signals.transforms import (
    box_cox,
    difference,
    likeliest_box_cox,
    output_levels,
    positive_shift,
    resample_recording,
)

Range = tuple[int, int, int]
"""A stretch of consecutive samples, the first sample of it and the one after the last."""


class _Stretch(NamedTuple):
    """Consecutive samples of a recording, at the rate that is prepared."""

    recording: Recording  # one segment
    number: int  # of its recording; the files for validation go on counting
    start: float  # time (s) of its first sample in its recording


def prepare(
    recording: Recording,
    settings: PreparationSettings,
    validation_recording: Recording | None = None,
    place: str = "",
    recorded: Sequence[str] = (),
) -> PreparedData:
    """Make recordings stationary, and divide them for estimation and validation.

    Each segment is resampled, its output Box-Cox transformed, and differenced; from each recording
    samples are discarded, and means of inputs and levels of outputs subtracted. Parameters are
    found from estimation samples alone. ``place`` (key) and ``recorded`` (files) are for errors.
    """
    key = f"{place}." if place else ""
    if validation_recording is not None:
        check_validation(recording, validation_recording, f"{key}validation_file")
        rate = recording.sampling_rate  # that of equal clocks differs by rounding
        validation_recording = replace(validation_recording, sampling_rate=rate)
    count_before = 1 + max(recording.segment_recordings)
    stretches = _stretches(recording, settings, 0, key)
    if validation_recording is not None:
        stretches += _stretches(validation_recording, settings, count_before, key)
    transforms = settings.transforms
    counts = (transforms.difference, transforms.difference_input)
    *parts, source = _divided(stretches, count_before, settings.split, max(counts), f"{key}split")
    stretches, parameter, shift = _transformed(
        stretches, transforms.box_cox, parts[0], f"{key}transforms.box_cox"
    )
    alone = count_before == 1 and stretches[-1].number <= 1
    like = stretches[0].recording
    levels: dict[int, tuple[tuple[float, ...], tuple[float, ...]]] = {}

    def part(name: str, ranges: Sequence[Range]) -> tuple[Recording, tuple[StretchOrigin, ...]]:
        segments: list[Segment] = []
        origins: list[StretchOrigin] = []
        for number, ours in groupby(ranges, lambda bounds: stretches[bounds[0]].number):
            sections = [_section(stretches[k], i, stop, transforms) for k, i, stop in ours]
            together = like.with_segments([segment for segment, _ in sections])
            # The means and levels of the first samples of a recording that are asked for.
            known = 0 if alone else number
            if known not in levels:
                means = tuple(together.inputs.mean(axis=0).tolist())
                levels[known] = means, output_levels(together)
            means, level = levels[known]
            called = recorded[number] if recorded else f"recording {number + 1}"
            called = f"{key}{name} (the samples of {called} as prepared)"
            check_recording(together, called, alone and name == "validation")
            for prepared, origin in sections:
                inputs, outputs = prepared.inputs - means, prepared.outputs - level
                segments.append(replace(prepared, inputs=inputs, outputs=outputs))
                origins.append(replace(origin, input_means=means, output_means=level))
        return like.with_segments(segments), tuple(origins)

    estimation, estimation_origins = part("estimation", parts[0])
    validation, validation_origins = part("validation", parts[1])
    rates = like.sampling_rate, recording.sampling_rate
    return PreparedData(
        estimation,
        validation,
        Transforms(
            sampling_rate=rates[0],
            resampled_from=rates[1] if rates[0] != rates[1] else None,
            estimation=estimation_origins,
            validation=validation_origins,
            # The level of a filter is found anew.
            validation_source="gap" if source == "cut" and transforms.difference_pole else source,
            box_cox=parameter,
            shift=shift,
            difference=counts[0],
            difference_input=counts[1],
            difference_pole=transforms.difference_pole,
        ),
    )


def _stretches(
    recording: Recording, settings: PreparationSettings, before: int, key: str
) -> list[_Stretch]:
    """The segments of recordings at the rate that is prepared; ``before`` them others count."""
    stretches = []
    for record, segment in zip(recording.separated, recording.segments, strict=True):
        start = segment.first / recording.sampling_rate
        if settings.resample is not None:
            record = resample_recording(record, settings.resample, f"{key}resample")
        stretches.append(_Stretch(record, before + segment.recording, start))
    return stretches


def _section(
    stretch: _Stretch, first: int, stop: int, transforms: TransformSettings
) -> tuple[Segment, StretchOrigin]:
    """Differenced samples and where they come from, their means and levels still unknown."""
    # Differences begin as many samples earlier as they cost, so that all channels stay aligned.
    recording, number, start = stretch
    rate = recording.sampling_rate
    d, du, pole = transforms.difference, transforms.difference_input, transforms.difference_pole
    outputs, output_initial = difference(recording.outputs[first - d : stop], d, pole)
    inputs, input_initial = difference(recording.inputs[first - du : stop], du, pole)
    place = round(start * rate) + first
    origin = StretchOrigin(
        recording=number,
        first=place,
        start=start + first / rate,
        samples=len(outputs),
        input_means=(),
        output_means=(),
        input_initial=input_initial,
        output_initial=output_initial,
    )
    return Segment(inputs, outputs, number, place), origin


def _divided(
    stretches: Sequence[_Stretch], n_own: int, split: SplitSettings, lost: int, key: str
) -> tuple[list[Range], list[Range], Source]:
    """The samples for estimation and for validation, and where the latter come from. Those of files
    for validation follow ``n_own``; differences take ``lost`` of a stretch first."""
    count = 1 + stretches[-1].number
    places = [[i for i, s in enumerate(stretches) if s.number == n] for n in range(count)]
    lengths = [max(stretch.recording.samples - lost, 0) for stretch in stretches]
    available = [sum(lengths[place] for place in group) for group in places]

    def ranges(number: int, first: int, stop: int) -> list[Range]:
        """The samples from one to before another of all that a recording has."""
        parts, begin = [], 0
        for place in places[number]:
            low, high = max(first - begin, 0), min(stop - begin, lengths[place])
            begin += lengths[place]
            parts.append((place, lost + low, lost + max(low, high)))
        longest = max(high - low for _, low, high in parts)
        if longest == 0 or (longest < MINIMUM_SAMPLES and len(parts) > 1):
            remedy = "divide the recording at another sample"
            raise InputError(key, "a gap leaves too few samples", remedy)
        # What is cut off beside a gap may be too short for an initial state to settle.
        least = min(LONG_STRETCH, longest)
        return [bounds for bounds in parts if bounds[2] - bounds[1] >= least]

    kept = n_own  # recordings that are not held out as a whole
    source: Source = "file" if n_own < count else "cut" if len(stretches) == n_own else "gap"
    if n_own == count > 1 and split.by == "recordings":
        totals = [sum(stretches[place].recording.samples for place in listed) for listed in places]
        held_out = np.cumsum(totals[:0:-1])  # by the last recordings, one of them at least
        wrong = np.abs(held_out - (1.0 - split.estimation) * sum(totals))
        kept, source = n_own - int(np.argmin(wrong)) - 1, "recordings"
    estimation: list[Range] = []
    validation: list[Range] = []
    for number, samples in enumerate(available):
        if number >= kept:
            validation += ranges(number, _discarded(samples, split, key), samples)
        elif kept < count > 2 or kept < n_own:
            estimation += ranges(number, _discarded(samples, split, key), samples)
        else:
            first, stop = _estimation_range(samples, split, kept == count, key)
            if count == 1 and split.estimation == SplitSettings().estimation:
                inputs = np.concatenate([stretch.recording.inputs[lost:] for stretch in stretches])
                stop = _before_last_change(inputs, first, stop) if inputs.shape[1] else stop
            estimation += ranges(number, first, stop)
            validation += ranges(number, stop, samples) if kept == count else []
    return estimation, validation, source


def _estimation_range(
    available: int, split: SplitSettings, cut: bool, source: str
) -> tuple[int, int]:
    """First estimation sample and the one after the last, among the differenced samples."""
    if available < 1:
        remedy = "difference less often or give a longer recording"
        raise InputError(source, "the differences leave no sample of the recording", remedy)
    first = _discarded(available, split, source)
    remaining = available - first
    samples = max(1, _number_of_samples(split.estimation, remaining))
    if samples > remaining:
        problem = f"{samples} samples are asked for and {remaining} remain after the discarded ones"
        remedy = "ask for fewer samples or a share such as 0.8"
        raise InputError(f"{source}.estimation", problem, remedy)
    if cut and samples == remaining:
        problem = f"all {remaining} samples are asked for, so none remain to validate on"
        remedy = "ask for fewer samples or name a validation_file"
        raise InputError(f"{source}.estimation", problem, remedy)
    return first, first + samples


def _before_last_change(inputs: Array, first: int, stop: int) -> int:
    """Where the validation samples begin when the built-in share is to test the inputs' response.
    That is `stop` unless all inputs, (N, m), rest from there on. Then it is a tenth of the samples
    before their last change, if half of the samples with a change remain for estimation."""
    if np.ptp(inputs[stop:], axis=0).any():
        return stop
    changes = first + np.flatnonzero(np.diff(inputs[first : stop + 1], axis=0).any(axis=1))
    available = len(inputs) - first
    begin = int(changes[-1]) - available // 10 if changes.size else first
    if 2 * (begin - first) < available or changes[0] + 1 >= begin:
        return stop
    return begin


def _discarded(available: int, split: SplitSettings, source: str) -> int:
    """Number of samples to leave out at the start of `available` ones."""
    discard = _number_of_samples(split.discard, available)
    if discard >= available:
        problem = f"{discard} samples are to be discarded and there are only {available}"
        raise InputError(f"{source}.discard", problem, "discard fewer samples")
    return discard


def _number_of_samples(value: float, available: int) -> int:
    """A number of samples (int) or a share of the available ones (float) as a number."""
    return value if isinstance(value, int) else round(value * available)


def _transformed(
    stretches: list[_Stretch], setting: float | str, estimation: Sequence[Range], source: str
) -> tuple[list[_Stretch], float | None, float]:
    """The stretches with Box-Cox transformed outputs, the parameter, and the shift before it. An
    automatic parameter is found from the ``estimation`` samples."""
    if setting == "none":
        return stretches, None, 0.0
    count = stretches[0].recording.outputs.shape[1]
    if count > 1:
        problem = f"the Box-Cox transform bends the scale of one output, and there are {count}"
        raise InputError(source, problem, "use box_cox: none")
    signals = [stretch.recording.output for stretch in stretches]
    shift = positive_shift(*signals)
    if setting == "auto":
        known = [signals[place][first:stop] for place, first, stop in estimation]
        parameter = likeliest_box_cox(np.concatenate(known), shift, source)
    else:
        parameter = float(setting)
    bent = []
    for stretch, signal in zip(stretches, signals, strict=True):
        outputs = box_cox(signal, parameter, shift, source)
        bent.append(stretch._replace(recording=replace(stretch.recording, outputs=outputs)))
    return bent, parameter, shift
