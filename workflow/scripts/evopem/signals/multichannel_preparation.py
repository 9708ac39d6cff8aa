"""From recordings of several channels to the samples a model is estimated and validated on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from evopem.config.settings import SplitSettings
from evopem.errors import InputError
from evopem.files.json_form import load, save
from evopem.files.npz import load_arrays, save_arrays
from evopem.signals.joining import check_independent, check_same_rate
from evopem.signals.recording import (
    Recording,
    concatenated,
    recording_arrays,
    recording_from_arrays,
    recording_names,
)
from evopem.signals.recording_checks import check_recording
from evopem.signals.resampling import resample_recording
from evopem.signals.sections import Range, divided_ranges, prepared_samples

Source = Literal["cut", "file", "recordings"]

SHORTEST_RECORD = 24
"""Samples that each of several recordings has at least: its initial state, which is estimated,
takes some of them up."""


@dataclass(frozen=True)
class RecordOrigin:
    """Where the prepared samples of one of several recordings come from.

    Attributes
    ----------
    recording : int
        Number of the recording, from 0; those of files for validation go on counting.
    first : int
        Its first sample, before decimation.
    samples : int
        Number of prepared samples.
    input_means, output_means : tuple of float
        Taken from its samples.
    """

    recording: int
    first: int
    samples: int
    input_means: tuple[float, ...]
    output_means: tuple[float, ...]


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
        Means of the estimation samples, taken from all samples; of several recordings those of the
        first.
    discard : int
        Samples left out at the start, before decimation; of several recordings of the first.
    estimation_samples, validation_samples : int
        Numbers of prepared samples.
    validation_source : {"cut", "file", "recordings"}
        ``cut``: the validation samples follow the estimation samples, in each recording; ``file``:
        they come from other files; ``recordings``: from the last recordings.
    estimation_records, validation_records : tuple of RecordOrigin
        Where there are several recordings: each has means of its own.
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
    validation_source: Source
    estimation_records: tuple[RecordOrigin, ...] = ()
    validation_records: tuple[RecordOrigin, ...] = ()


@dataclass(frozen=True, eq=False)
class MultichannelData:
    """Samples for estimation and for validation, without means, and what was done to them."""

    estimation: Recording
    validation: Recording
    transforms: MultichannelTransforms

    @property
    def before_validation(self) -> Recording | None:
        """The samples that the validation samples continue; None where they are of others."""
        joints = len(self.estimation.segment_starts), len(self.validation.segment_starts)
        cut = self.transforms.validation_source == "cut" and joints[0] == joints[1]
        return self.estimation if cut else None


def divide_multichannel(
    recording: Recording,
    split: SplitSettings,
    resample: float | None,
    validation: Recording | None,
    place: str,
    recorded: Sequence[str] = (),
) -> MultichannelData:
    """Resample and divide recordings; nothing is decimated yet.

    One recording is cut at ``split.estimation``.  Of several the last ones validate, or, with
    ``split.by`` of ``samples``, the last samples of each; ``discard`` applies to each.

    Parameters
    ----------
    recording : Recording
    split : SplitSettings
    resample : float, optional
        New sampling rate in Hz.
    validation : Recording, optional
        Independent recordings to validate on.
    place : str
        Configuration key of the data set, for errors to name.
    recorded : sequence of str
        Files of the recordings and of those for validation, for errors to name.

    Raises
    ------
    InputError
        When the recording cannot be divided or resampled, or the two recordings do not have the
        same channels and rate.
    """
    recorded_rate = recording.sampling_rate
    if validation is not None:
        _check_alike(recording, validation, f"{place}.validation_file")
    others = () if validation is None else validation.separated
    records = [*recording.separated, *others]
    if resample is not None:
        records = [resample_recording(each, resample, f"{place}.resample") for each in records]
    own = len(recording.separated)
    ranges = divided_ranges(records, own, split, 0, f"{place}.split")
    estimation, held_out = ranges.estimation, ranges.validation
    fitted, scored = _cut(records, estimation), _cut(records, held_out)
    for name, part, used in (
        ("estimation", fitted, estimation),
        ("validation", scored, held_out),
    ):
        for record, (number, *_) in zip(part.separated, used, strict=True):
            called = prepared_samples(f"{place}.{name}", recorded, number)
            check_recording(record, called)
            if name == "estimation" and own > 1:
                _check_length(record, called)
    several = own > 1 or len(others) > 1
    return centred(
        fitted,
        scored,
        MultichannelTransforms(
            sampling_rate=records[0].sampling_rate,
            recorded_rate=recorded_rate,
            resampled=records[0].sampling_rate != recorded_rate,
            decimation=1,
            input_means=(0.0,) * len(recording.input_names),
            output_means=(0.0,) * len(recording.output_names),
            discard=estimation[0][1],
            estimation_samples=0,
            validation_samples=0,
            validation_source="cut" if ranges.source == "gap" else ranges.source,
            estimation_records=_origins(recording, estimation) if several else (),
            validation_records=_origins(recording, held_out) if several else (),
        ),
    )


def centred(
    estimation: Recording,
    validation: Recording,
    before: MultichannelTransforms,
) -> MultichannelData:
    """Take the means from both parts, and add them to those that were taken before.

    Both parts of one recording lose the means of the first.

    Parameters
    ----------
    estimation, validation : Recording
    before : MultichannelTransforms
    """
    means = [_means(each) for each in estimation.separated]
    one = before.validation_source == "cut" or not before.estimation_records
    held_out = means if one else [_means(each) for each in validation.separated]
    parts = [_less(estimation, means), _less(validation, held_out)]
    return MultichannelData(
        parts[0],
        parts[1],
        replace(
            before,
            sampling_rate=estimation.sampling_rate,
            input_means=_sums(before.input_means, means[0][0]),
            output_means=_sums(before.output_means, means[0][1]),
            estimation_samples=estimation.samples,
            validation_samples=validation.samples,
            estimation_records=_with_means(before.estimation_records, estimation, means),
            validation_records=_with_means(before.validation_records, validation, held_out),
        ),
    )


def save_multichannel_data(data: MultichannelData, arrays: str | Path, transforms: str) -> None:
    """Write the samples to one ``.npz`` and the transforms to a JSON file."""
    save_arrays(
        arrays,
        recording_arrays(data.estimation, "estimation_")
        | recording_arrays(data.validation, "validation_"),
    )
    save(data.transforms, transforms)


def load_multichannel_data(arrays: str | Path, transforms: str | Path) -> MultichannelData:
    """Read what `save_multichannel_data` wrote.

    Raises
    ------
    InputError
        When either file is missing or damaged.
    """
    names = recording_names("estimation_") + recording_names("validation_")
    stored = load_arrays(arrays, names)
    return MultichannelData(
        estimation=recording_from_arrays(stored, "estimation_"),
        validation=recording_from_arrays(stored, "validation_"),
        transforms=load(MultichannelTransforms, transforms),
    )


def _check_alike(recording: Recording, validation: Recording, place: str) -> None:
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


def _cut(records: Sequence[Recording], ranges: Sequence[Range]) -> Recording:
    return concatenated([records[number].between(first, stop) for number, first, stop in ranges])


def _check_length(record: Recording, called: str) -> None:
    if record.samples < SHORTEST_RECORD:
        raise InputError(
            called,
            f"there are only {record.samples}, and each of several recordings needs"
            f" {SHORTEST_RECORD} for estimation",
            "leave it out of the data set, or record longer",
        )


def _origins(recording: Recording, ranges: Sequence[Range]) -> tuple[RecordOrigin, ...]:
    none = (0.0,) * len(recording.input_names), (0.0,) * len(recording.output_names)
    return tuple(RecordOrigin(number, first, stop - first, *none) for number, first, stop in ranges)


_Means = tuple[tuple[float, ...], tuple[float, ...]]
"""Of the inputs and of the outputs."""


def _means(record: Recording) -> _Means:
    return tuple(record.inputs.mean(axis=0).tolist()), tuple(record.outputs.mean(axis=0).tolist())


def _less(recording: Recording, means: Sequence[_Means]) -> Recording:
    """Each record without its means."""
    return concatenated(
        [
            replace(each, inputs=each.inputs - own[0], outputs=each.outputs - own[1])
            for each, own in zip(recording.separated, means, strict=True)
        ]
    )


def _with_means(
    origins: Sequence[RecordOrigin], recording: Recording, means: Sequence[_Means]
) -> tuple[RecordOrigin, ...]:
    return tuple(
        replace(
            origin,
            samples=record.samples,
            input_means=_sums(origin.input_means, own[0]),
            output_means=_sums(origin.output_means, own[1]),
        )
        for origin, record, own in zip(origins, recording.separated, means, strict=False)
    )


def _sums(means: Sequence[float], further: Sequence[float]) -> tuple[float, ...]:
    return tuple(one + other for one, other in zip(means, further, strict=True))
