"""From a recording to the samples a model is estimated and validated on, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import PreparationSettings
from evopem.errors import check_choice
from evopem.files.json_form import load, save
from evopem.files.npz import load_arrays, save_arrays
from evopem.signals.joining import check_same_rate
from evopem.signals.output_level import output_level
from evopem.signals.recording import (
    Recording,
    recording_arrays,
    recording_from_arrays,
    recording_names,
)
from evopem.signals.recording_checks import check_recording
from evopem.signals.resampling import resample_recording
from evopem.signals.sections import (
    Range,
    check_differences,
    divided_ranges,
    prepared_samples,
    section,
    transform_outputs,
)
from evopem.signals.transforms import invert_box_cox, invert_difference

Part = Literal["estimation", "validation"]


@dataclass(frozen=True)
class StretchOrigin:
    """Where one of several stretches of prepared samples comes from, and what undoes its means.

    Attributes
    ----------
    recording : int
        Number of the recording, from 0.
    first : int
        Its first sample in the recording, at the prepared rate.
    samples : int
    input_mean, output_mean : float
        Taken from all samples of the stretch.
    difference_initial, difference_input_initial : tuple of float
        Values that the differences start from, at its first sample.
    """

    recording: int
    first: int
    samples: int
    input_mean: float
    output_mean: float
    difference_initial: tuple[float, ...] = ()
    difference_input_initial: tuple[float, ...] = ()


@dataclass(frozen=True)
class Transforms:
    """Every parameter that takes prepared samples back to measured ones.

    Attributes
    ----------
    sampling_rate : float
        Rate of the prepared samples (Hz).
    resampled_from : float or None
        The recording's own rate (Hz) when it was resampled.
    box_cox : float or None
        Parameter λ of the output's Box-Cox transform.
    shift : float
        Added to the output before it; 0.0 when the output was positive already.
    difference, difference_input : int
        How many times the output and the input were differenced.
    difference_initial, difference_input_initial : tuple of float
        Values the differences start from, at the first estimation sample.
    input_mean, output_mean : float
        Mean of the input and level of the output (:func:`output_level`) in the estimation samples,
        taken from all samples.
    discard : int
        Samples dropped at the start, after the differences.
    validation_difference_initial, validation_difference_input_initial : tuple of float
        Values the differences start from, at the first validation sample.
    estimation_samples, validation_samples : int
        Numbers of prepared samples.
    validation_source : {"cut", "gap", "file", "recordings"}
        ``cut``: the validation samples follow the estimation samples without a gap; ``gap``: they
        follow later in the recording; ``file``: they come from another recording;
        ``recordings``: they are the last recordings of the data set.
    estimation_stretches, validation_stretches : tuple of StretchOrigin
        Of several stretches, in whose place the numbers above are those of the first; empty for
        one stretch.
    input_trend, output_trend : float
        Slopes that were taken from the channels, in their units per second, from the first sample
        of the recording on.
    trend_start, validation_trend_start : float
        Times of the first estimation and validation sample in the recording (s), for the trends.
    """

    sampling_rate: float
    resampled_from: float | None
    box_cox: float | None
    shift: float
    difference: int
    difference_initial: tuple[float, ...]
    difference_input: int
    difference_input_initial: tuple[float, ...]
    input_mean: float
    output_mean: float
    discard: int
    validation_difference_initial: tuple[float, ...]
    validation_difference_input_initial: tuple[float, ...]
    estimation_samples: int
    validation_samples: int
    validation_source: Literal["cut", "gap", "file", "recordings"]
    estimation_stretches: tuple[StretchOrigin, ...] = ()
    validation_stretches: tuple[StretchOrigin, ...] = ()
    input_trend: float = 0.0
    output_trend: float = 0.0
    trend_start: float = 0.0
    validation_trend_start: float = 0.0

    def of_stretches(self, part: Part) -> tuple[Transforms, ...]:
        """The transforms of each stretch of a part alone."""
        origins = self.estimation_stretches if part == "estimation" else self.validation_stretches
        if not origins:
            return (self,)
        return tuple(
            replace(
                self,
                input_mean=each.input_mean,
                output_mean=each.output_mean,
                difference_initial=each.difference_initial,
                difference_input_initial=each.difference_input_initial,
                validation_difference_initial=each.difference_initial,
                validation_difference_input_initial=each.difference_input_initial,
                estimation_stretches=(),
                validation_stretches=(),
                trend_start=each.first / self.sampling_rate,
                validation_trend_start=each.first / self.sampling_rate,
            )
            for each in origins
        )

    @property
    def changes_output(self) -> bool:
        """Whether the prepared output differs from the recorded one by more than its mean."""
        has_trend = self.output_trend != 0.0
        return self.box_cox is not None or self.difference > 0 or has_trend

    def trend_times(self, samples: int, part: Part) -> NDArray[np.float64]:
        """Times of samples of a part in the recording (s)."""
        start = self.trend_start if part == "estimation" else self.validation_trend_start
        return start + np.arange(samples) / self.sampling_rate


@dataclass(frozen=True)
class PreparedData:
    """Stationary, zero-mean samples, divided for estimation and validation.

    Attributes
    ----------
    estimation, validation : Recording
        The two parts.
    transforms : Transforms
        What was done to the recording.
    """

    estimation: Recording
    validation: Recording
    transforms: Transforms

    @property
    def contiguous(self) -> bool:
        """Whether the validation samples follow the estimation samples without a gap."""
        return self.transforms.validation_source == "cut"


@dataclass(frozen=True, eq=False)
class _Section:
    """Prepared samples of one recording with their origin."""

    recording: Recording
    origin: StretchOrigin


def prepare(
    recording: Recording,
    settings: PreparationSettings,
    validation_recording: Recording | None = None,
    place: str = "",
    recorded: Sequence[str] = (),
) -> PreparedData:
    """Make one or several recordings stationary, and divide them for estimation and validation.

    In this order: resample; Box-Cox transform of the output; differences of the output and
    of the input, the other signal losing its first samples so that both stay aligned;
    discard; cut; subtract the input's mean and the output's level in the estimation samples. A
    validation recording passes through the same transforms with the same parameters. An
    automatic Box-Cox parameter is found from the estimation samples alone.

    Several recordings are resampled and differenced each by itself, ``discard`` applies to each,
    and each is freed of its own mean and level. Without a validation recording the last recordings
    validate, or, with ``split.by`` of ``samples``, the last samples of each.

    Parameters
    ----------
    recording : Recording
        The measured signals, with one segment for each recording; not modified.
    settings : PreparationSettings
        With a validation recording, ``split.estimation`` of 1.0 takes all samples.
    validation_recording : Recording, optional
        One or several independent recordings to validate on.
    place : str, optional
        Configuration key of the data set, such as ``datasets.arm``, for errors to name.
    recorded : sequence of str
        Files of the recordings, those for validation last, for errors to name.

    Raises
    ------
    InputError
        When a setting is not of its kind, the split goes beyond the end, a transform
        cannot be applied or leaves nothing that varies, or the recordings were
        sampled at different rates.
    """
    key = f"{place}." if place else ""
    own = recording.separated
    others = () if validation_recording is None else validation_recording.separated
    if validation_recording is not None:
        check_same_rate(recording, validation_recording, f"{key}validation_file")
    records = [*own, *others]
    if settings.resample is not None:
        records = [resample_recording(one, settings.resample, f"{key}resample") for one in records]
    transforms = settings.transforms
    check_differences(transforms, f"{key}transforms")
    counts = (transforms.difference, transforms.difference_input)
    ranges = divided_ranges(records, len(own), settings.split, max(counts), f"{key}split")
    records, parameter, shift = transform_outputs(
        records, transforms.box_cox, ranges.estimation, f"{key}transforms.box_cox"
    )
    alone = len(own) == 1 and len(others) <= 1
    levels: dict[int, tuple[float, float]] = {}
    parts: dict[Part, list[_Section]] = {}
    for part in get_args(Part):
        parts[part] = [_section(records, each, counts, levels, alone) for each in ranges.of(part)]
        for each in parts[part]:
            called = prepared_samples(f"{key}{part}", recorded, each.origin.recording)
            check_recording(each.recording, called, alone and part == "validation")
    estimation, validation = (_joined(parts[part], alone) for part in get_args(Part))
    origins, held_out = (tuple(each.origin for each in parts[part]) for part in get_args(Part))
    first = origins[0]
    return PreparedData(
        estimation,
        validation,
        Transforms(
            sampling_rate=estimation.sampling_rate,
            resampled_from=recording.sampling_rate
            if estimation.sampling_rate != recording.sampling_rate
            else None,
            box_cox=parameter,
            shift=shift,
            difference=counts[0],
            difference_initial=first.difference_initial,
            difference_input=counts[1],
            difference_input_initial=first.difference_input_initial,
            input_mean=first.input_mean,
            output_mean=first.output_mean,
            discard=first.first - max(counts),
            validation_difference_initial=held_out[0].difference_initial,
            validation_difference_input_initial=held_out[0].difference_input_initial,
            estimation_samples=estimation.samples,
            validation_samples=validation.samples,
            validation_source=ranges.source,
            estimation_stretches=() if alone else origins,
            validation_stretches=() if alone else held_out,
        ),
    )


def _section(
    records: Sequence[Recording],
    samples: Range,
    counts: tuple[int, int],
    levels: dict[int, tuple[float, float]],
    alone: bool,
) -> _Section:
    """Samples less the mean and level of their recording, or of the estimation samples.

    Those are the mean and level of the first samples of it that are asked for.
    """
    number, start, stop = samples
    cut, (input_initial, initial) = section(records[number], start, stop, counts)
    known = 0 if alone else number
    if known not in levels:
        levels[known] = (float(cut.input.mean()), output_level(cut))
    mean, level = levels[known]
    origin = StretchOrigin(number, start, cut.samples, mean, level, initial, input_initial)
    return _Section(cut.with_signals(cut.input - mean, cut.output - level), origin)


def _joined(sections: Sequence[_Section], alone: bool) -> Recording:
    if alone:
        return sections[0].recording
    segments = [
        replace(each.recording.segments[0], recording=each.origin.recording) for each in sections
    ]
    return sections[0].recording.with_segments(segments)


def invert_output(
    transforms: Transforms, output: NDArray[np.float64], part: Part = "estimation"
) -> NDArray[np.float64]:
    """Take prepared output samples back to the measured unit.

    Parameters
    ----------
    transforms : Transforms
    output : ndarray, shape (n,)
        Prepared output samples without a gap, from the first sample of `part` on: the
        part itself, or, after a cut, estimation and validation samples joined.
    part : {"estimation", "validation"}
        Whose first sample `output` begins with; it decides which start values the
        differences are summed up from.

    Returns
    -------
    ndarray, shape (n + difference,)
        Output at the prepared rate in the measured unit. The first `difference` samples
        are those just before the part, kept as start values. Rounding errors grow with
        the summation, see `invert_difference`; resampling itself is not undone.
    """
    check_choice("part", part, get_args(Part))
    initial = (
        transforms.difference_initial
        if part == "estimation"
        else transforms.validation_difference_initial
    )
    measured = invert_difference(output + transforms.output_mean, initial)
    if transforms.box_cox is not None:
        measured = invert_box_cox(measured, transforms.box_cox, transforms.shift)
    if transforms.output_trend:
        measured = measured + transforms.output_trend * transforms.trend_times(len(measured), part)
    return measured


def invert_input(
    transforms: Transforms,
    input: NDArray[np.float64],  # noqa: A002
    part: Part = "estimation",
) -> NDArray[np.float64]:
    """Take prepared input samples back to the measured unit, as `invert_output` does."""
    check_choice("part", part, get_args(Part))
    initial = (
        transforms.difference_input_initial
        if part == "estimation"
        else transforms.validation_difference_input_initial
    )
    measured = invert_difference(input + transforms.input_mean, initial)
    if transforms.input_trend:
        measured = measured + transforms.input_trend * transforms.trend_times(len(measured), part)
    return measured


def save_prepared(prepared: PreparedData, arrays: str | Path, transforms: str | Path) -> None:
    """Write the samples to one ``.npz`` and the transforms to a JSON file."""
    save_arrays(
        arrays,
        recording_arrays(prepared.estimation, "estimation_")
        | recording_arrays(prepared.validation, "validation_"),
    )
    save(prepared.transforms, transforms)


def load_prepared(arrays: str | Path, transforms: str | Path) -> PreparedData:
    """Read what `save_prepared` wrote.

    Raises
    ------
    InputError
        When either file is missing or damaged.
    """
    names = recording_names("estimation_") + recording_names("validation_")
    stored = load_arrays(arrays, names)
    return PreparedData(
        estimation=recording_from_arrays(stored, "estimation_"),
        validation=recording_from_arrays(stored, "validation_"),
        transforms=load(Transforms, transforms),
    )
