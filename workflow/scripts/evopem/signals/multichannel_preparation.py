"""From a recording of several channels to the samples a model is estimated and validated on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import SplitSettings
from evopem.errors import InputError
from evopem.files.json_form import load, save
from evopem.files.npz import load_arrays, save_arrays
from evopem.signals.joining import check_same_rate
from evopem.signals.multichannel import (
    MultichannelRecording,
    check_multichannel,
    multichannel_arrays,
    multichannel_from_arrays,
    multichannel_names,
)
from evopem.signals.resampling import resample_recording
from evopem.signals.sections import estimation_range
from evopem.signals.shared_samples import check_independent

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MultichannelTransforms:
    """What leads from the recorded samples to the prepared ones.

    Attributes
    ----------
    sampling_rate : float
        Rate of the prepared samples (Hz).
    recorded_rate : float
        Rate of the recording (Hz).
    resampled : bool
        Whether the configuration's new rate was applied.
    decimation : int
        Factor by which the rate was divided after that; 1 for none.
    input_means, output_means : tuple of float
        Means of the estimation samples, taken from all samples.
    discard : int
        Samples left out at the start, before decimation.
    estimation_samples, validation_samples : int
        Numbers of prepared samples.
    validation_source : {"cut", "file"}
        ``cut``: the validation samples follow the estimation samples; ``file``: they come from
        another recording.
    """

    sampling_rate: float
    recorded_rate: float
    resampled: bool
    decimation: int
    input_means: tuple[float, ...]
    output_means: tuple[float, ...]
    discard: int
    estimation_samples: int
    validation_samples: int
    validation_source: Literal["cut", "file"]


@dataclass(frozen=True, eq=False)
class MultichannelData:
    """Both parts of a recording, without the means of the first, and what was done to it."""

    estimation: MultichannelRecording
    validation: MultichannelRecording
    transforms: MultichannelTransforms


def divide_multichannel(
    recording: MultichannelRecording,
    split: SplitSettings,
    resample: float | None,
    validation: MultichannelRecording | None,
    place: str,
) -> MultichannelData:
    """Resample and divide a recording; nothing is decimated yet.

    Parameters
    ----------
    recording : MultichannelRecording
    split : SplitSettings
    resample : float, optional
        New sampling rate in Hz.
    validation : MultichannelRecording, optional
        An independent recording to validate on.
    place : str
        Configuration key of the data set, for errors to name.

    Raises
    ------
    InputError
        When the recording cannot be divided or resampled, or the two recordings do not have the
        same channels and rate.
    """
    recorded_rate = recording.sampling_rate
    if validation is not None:
        _check_alike(recording, validation, f"{place}.validation_file")
    parts = [recording] if validation is None else [recording, validation]
    if resample is not None:
        parts = [_resampled(each, resample, f"{place}.resample") for each in parts]
    first, stop = estimation_range(parts[0].samples, split, validation is None, f"{place}.split")
    estimation = parts[0].between(first, stop)
    held_out = parts[0].between(stop, parts[0].samples) if validation is None else parts[1]
    check_multichannel(estimation, f"{place}.estimation (the samples as prepared)", measured=False)
    check_multichannel(held_out, f"{place}.validation (the samples as prepared)", measured=False)
    input_means, output_means = estimation.inputs.mean(axis=0), estimation.outputs.mean(axis=0)
    centred = [
        replace(each, inputs=each.inputs - input_means, outputs=each.outputs - output_means)
        for each in (estimation, held_out)
    ]
    return MultichannelData(
        centred[0],
        centred[1],
        MultichannelTransforms(
            sampling_rate=parts[0].sampling_rate,
            recorded_rate=recorded_rate,
            resampled=parts[0].sampling_rate != recorded_rate,
            decimation=1,
            input_means=tuple(map(float, input_means)),
            output_means=tuple(map(float, output_means)),
            discard=first,
            estimation_samples=estimation.samples,
            validation_samples=held_out.samples,
            validation_source="cut" if validation is None else "file",
        ),
    )


def save_multichannel_data(data: MultichannelData, arrays: str | Path, transforms: str) -> None:
    """Write the samples to one ``.npz`` and the transforms to a JSON file."""
    save_arrays(
        arrays,
        multichannel_arrays(data.estimation, "estimation_")
        | multichannel_arrays(data.validation, "validation_"),
    )
    save(data.transforms, transforms)


def load_multichannel_data(arrays: str | Path, transforms: str | Path) -> MultichannelData:
    """Read what `save_multichannel_data` wrote.

    Raises
    ------
    InputError
        When either file is missing or damaged.
    """
    names = multichannel_names("estimation_") + multichannel_names("validation_")
    stored = load_arrays(arrays, names)
    return MultichannelData(
        estimation=multichannel_from_arrays(stored, "estimation_"),
        validation=multichannel_from_arrays(stored, "validation_"),
        transforms=load(MultichannelTransforms, transforms),
    )


def _check_alike(
    recording: MultichannelRecording, validation: MultichannelRecording, place: str
) -> None:
    """Refuse a validation recording of another rate, of other channels, or of the same samples."""
    check_same_rate(recording, validation, place)
    for role in ("input", "output"):
        own, other = getattr(recording, f"{role}_names"), getattr(validation, f"{role}_names")
        if len(own) != len(other):
            raise InputError(
                place,
                f"it has {len(other)} {role}s and the estimation recording {len(own)}",
                "validate on a recording of the same channels",
            )
    check_independent(recording.channel(0), validation.channel(0), place)


def _resampled(recording: MultichannelRecording, rate: float, place: str) -> MultichannelRecording:
    """Every channel at a lower rate, through the same filter."""
    pairs = [resample_recording(each, rate, place) for each in recording.pairs()]
    outputs, nu = recording.outputs.shape[1], recording.inputs.shape[1]
    inputs = {each.input_name: each.input for each in pairs if each.has_input}
    return replace(
        recording,
        inputs=np.column_stack([inputs[name] for name in recording.input_names])
        if nu
        else np.empty((pairs[0].samples, 0)),
        outputs=np.column_stack([each.output for each in pairs[:outputs]]),
        sampling_rate=pairs[0].sampling_rate,
    )
