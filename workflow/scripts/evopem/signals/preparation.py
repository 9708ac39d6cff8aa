"""From a recording to the samples a model is estimated and validated on, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import PreparationSettings, SplitSettings
from evopem.errors import check_choice
from evopem.files.json_form import load, save
from evopem.files.npz import load_arrays, save_arrays
from evopem.signals.joining import check_same_rate
from evopem.signals.output_level import output_level
from evopem.signals.recording import (
    Recording,
    check_recording,
    recording_arrays,
    recording_from_arrays,
    recording_names,
)
from evopem.signals.resampling import resample_recording
from evopem.signals.sections import (
    before_last_change,
    check_differences,
    discarded,
    estimation_range,
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


def prepare(
    recording: Recording,
    settings: PreparationSettings,
    validation_recording: Recording | None = None,
    place: str = "",
    recorded: Sequence[str] = (),
) -> PreparedData:
    """Make a recording stationary and divide it for estimation and validation.

    In this order: resample; Box-Cox transform of the output; differences of the output and
    of the input, the other signal losing its first samples so that both stay aligned;
    discard; cut; subtract the input's mean and the output's level in the estimation samples. A
    validation recording passes through the same transforms with the same parameters. An
    automatic Box-Cox parameter is found from the estimation samples alone.

    Parameters
    ----------
    recording : Recording
        The measured signals; not modified.
    settings : PreparationSettings
        With a validation recording, ``split.estimation`` of 1.0 takes all samples.
    validation_recording : Recording, optional
        An independent recording to validate on, instead of the end of this one.
    place : str, optional
        Configuration key of the data set, such as ``datasets.arm``, for errors to name.
    recorded : sequence of str
        The recorded file, and the one for validation, for errors to name.

    Returns
    -------
    PreparedData

    Raises
    ------
    InputError
        When a setting is not of its kind, the split goes beyond the end, a transform
        cannot be applied or leaves nothing that varies, or the two recordings were
        sampled at different rates.
    """
    key = f"{place}." if place else ""
    resampled_from = None
    records = [recording]
    if validation_recording is not None:
        check_same_rate(recording, validation_recording, f"{key}validation_file")
        records.append(validation_recording)
    if settings.resample is not None:
        records = [resample_recording(one, settings.resample, f"{key}resample") for one in records]
        if records[0].sampling_rate != recording.sampling_rate:
            resampled_from = recording.sampling_rate

    transforms = settings.transforms
    check_differences(transforms, f"{key}transforms")
    differences, differences_input = transforms.difference, transforms.difference_input
    lost = max(differences, differences_input)
    (start, stop), held_out_range = _ranges(records, settings.split, lost, f"{key}split")

    records, parameter, shift = transform_outputs(
        records, transforms.box_cox, [(0, start, stop)], f"{key}transforms.box_cox"
    )
    counts = (differences, differences_input)
    estimation, estimation_initial = section(records[0], start, stop, counts)
    validation, validation_initial = section(records[-1], *held_out_range, counts)

    input_mean, output_mean = float(estimation.input.mean()), output_level(estimation)
    centred = [
        replace(part, input=part.input - input_mean, output=part.output - output_mean)
        for part in (estimation, validation)
    ]
    check_recording(centred[0], prepared_samples(f"{key}estimation", recorded, 0))
    held_out = len(records) - 1
    check_recording(
        centred[1], prepared_samples(f"{key}validation", recorded, held_out), constant_input=True
    )
    return PreparedData(
        estimation=centred[0],
        validation=centred[1],
        transforms=Transforms(
            sampling_rate=records[0].sampling_rate,
            resampled_from=resampled_from,
            box_cox=parameter,
            shift=shift,
            difference=differences,
            difference_initial=estimation_initial[1],
            difference_input=differences_input,
            difference_input_initial=estimation_initial[0],
            input_mean=input_mean,
            output_mean=output_mean,
            discard=start - lost,
            validation_difference_initial=validation_initial[1],
            validation_difference_input_initial=validation_initial[0],
            estimation_samples=centred[0].samples,
            validation_samples=centred[1].samples,
            validation_source="cut" if validation_recording is None else "file",
        ),
    )


def _ranges(
    records: Sequence[Recording], split: SplitSettings, lost: int, key: str
) -> tuple[tuple[int, int], tuple[int, int]]:
    """First sample and the one after the last, of the estimation and of the validation samples.

    The latter are the rest of the one recording, or those of the second.  ``lost`` is the number of
    samples at the beginning that differences take away.
    """
    own = len(records) == 1
    start, stop = estimation_range(records[0].samples - lost, split, own, key)
    if own and split.estimation == SplitSettings().estimation:
        stop = before_last_change(records[0].input[lost:], start, stop)
    begin = stop + lost if own else lost + discarded(records[1].samples - lost, split, key)
    return (start + lost, stop + lost), (begin, records[-1].samples)


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
