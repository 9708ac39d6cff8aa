"""Preparation of several recordings of one system: each by itself, with common transforms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from evopem.config.settings import PreparationSettings, SplitSettings
from evopem.signals.joining import check_same_rate, separated
from evopem.signals.output_level import output_level
from evopem.signals.preparation import PreparedData, StretchOrigin, Transforms, prepare
from evopem.signals.recording import Recording, check_recording
from evopem.signals.resampling import resample_recording
from evopem.signals.sections import (
    check_differences,
    discarded,
    estimation_range,
    prepared_samples,
    section,
    transform_outputs,
)

Range = tuple[int, int, int]
"""A recording, its first sample and the one after its last."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A prepared stretch with its origin."""

    recording: Recording
    origin: StretchOrigin


def prepare_recordings(
    recording: Recording,
    settings: PreparationSettings,
    validation_recording: Recording | None = None,
    place: str = "",
    recorded: Sequence[str] = (),
) -> PreparedData:
    """Make one or several recordings stationary, and divide them for estimation and validation.

    One recording is prepared by :func:`.preparation.prepare`.  Several are resampled and
    differenced each by itself, ``discard`` applies to each, and each is freed of its own mean and
    level.  The Box-Cox parameter and shift are common.  Without a validation recording the last
    recordings validate, or, with ``split.by`` of ``samples``, the last samples of each.

    Parameters
    ----------
    recording : Recording
        With one stretch for each recording.
    settings : PreparationSettings
    validation_recording : Recording, optional
        One or several independent recordings.
    place : str, optional
        Configuration key of the data set, for errors to name.
    recorded : sequence of str
        Files of the recordings, those for validation last, for errors to name.

    Raises
    ------
    InputError
        As for :func:`.preparation.prepare`.
    """
    others = [] if validation_recording is None else separated(validation_recording)
    if not recording.is_joined and len(others) <= 1:
        return prepare(recording, settings, validation_recording, place, recorded)
    key = f"{place}." if place else ""
    own, rate = separated(recording), recording.sampling_rate
    if validation_recording is not None:
        check_same_rate(recording, validation_recording, f"{key}validation_file")
    records = [*own, *others]
    if settings.resample is not None:
        at = f"{key}resample"
        records = [resample_recording(each, settings.resample, at) for each in records]
    transforms = settings.transforms
    check_differences(transforms, f"{key}transforms")
    counts = (transforms.difference, transforms.difference_input)
    lengths = [each.samples for each in records]
    estimation, validation, source = divided_ranges(
        lengths, len(own), settings.split, max(counts), key
    )
    records, parameter, shift = transform_outputs(
        records, transforms.box_cox, estimation, f"{key}transforms.box_cox"
    )
    levels: dict[int, tuple[float, float]] = {}
    parts = {
        "estimation": [_part(records, each, counts, levels) for each in estimation],
        "validation": [_part(records, each, counts, levels) for each in validation],
    }
    for name, found in parts.items():
        for each in found:
            called = prepared_samples(f"{key}{name}", recorded, each.origin.recording)
            check_recording(each.recording, called)
    joined = {name: _joined(found) for name, found in parts.items()}
    origins = {name: tuple(each.origin for each in found) for name, found in parts.items()}
    first, held_out = origins["estimation"][0], origins["validation"][0]
    prepared_rate = records[0].sampling_rate
    return PreparedData(
        joined["estimation"],
        joined["validation"],
        Transforms(
            sampling_rate=prepared_rate,
            resampled_from=rate if prepared_rate != rate else None,
            box_cox=parameter,
            shift=shift,
            difference=counts[0],
            difference_initial=first.difference_initial,
            difference_input=counts[1],
            difference_input_initial=first.difference_input_initial,
            input_mean=first.input_mean,
            output_mean=first.output_mean,
            discard=first.first - max(counts),
            validation_difference_initial=held_out.difference_initial,
            validation_difference_input_initial=held_out.difference_input_initial,
            estimation_samples=joined["estimation"].samples,
            validation_samples=joined["validation"].samples,
            validation_source=source,
            estimation_stretches=origins["estimation"],
            validation_stretches=origins["validation"],
        ),
    )


def held_out_recordings(samples: Sequence[int], share: float) -> int:
    """How many of the last recordings hold about a share of all samples; at least one.

    Examples
    --------
    >>> held_out_recordings([100, 100, 100, 100, 100], 0.2)
    1
    >>> held_out_recordings([500, 50, 60], 0.2)
    2
    """
    held = np.cumsum(samples[:0:-1])
    return int(np.argmin(np.abs(held - share * sum(samples)))) + 1


def divided_ranges(
    lengths: Sequence[int], own: int, split: SplitSettings, lost: int, key: str
) -> tuple[list[Range], list[Range], Literal["file", "recordings", "gap"]]:
    """The samples for estimation and for validation, and where the latter come from.

    Parameters
    ----------
    lengths : sequence of int
        Samples of each recording; those of another file for validation stand last.
    own : int
        Number of recordings of the data set itself.
    split : SplitSettings
    lost : int
        First samples of each recording that its differences cost.
    key : str
        Configuration key of the data set and a dot, for errors to name.
    """

    def whole(number: int) -> Range:
        samples = lengths[number]
        return number, lost + discarded(samples - lost, split, f"{key}split"), samples

    every = range(len(lengths))
    if own < len(lengths):
        return [whole(n) for n in every[:own]], [whole(n) for n in every[own:]], "file"
    if split.by == "recordings":
        kept = own - held_out_recordings(lengths, 1.0 - split.estimation)
        return [whole(n) for n in every[:kept]], [whole(n) for n in every[kept:]], "recordings"
    estimation, validation = [], []
    for number, samples in enumerate(lengths):
        start, stop = estimation_range(samples - lost, split, True, f"{key}split")
        estimation.append((number, start + lost, stop + lost))
        validation.append((number, stop + lost, samples))
    return estimation, validation, "gap"


def _part(
    records: Sequence[Recording],
    samples: Range,
    counts: tuple[int, int],
    levels: dict[int, tuple[float, float]],
) -> _Part:
    """A stretch less the mean and level of its recording: those of its first stretch."""
    number, start, stop = samples
    cut, (input_initial, initial) = section(records[number], start, stop, counts)
    if number not in levels:
        levels[number] = (float(cut.input.mean()), output_level(cut))
    mean, level = levels[number]
    origin = StretchOrigin(number, start, cut.samples, mean, level, initial, input_initial)
    return _Part(replace(cut, input=cut.input - mean, output=cut.output - level), origin)


def _joined(parts: Sequence[_Part]) -> Recording:
    stretches = [
        replace(each.recording.stretches[0], recording=each.origin.recording) for each in parts
    ]
    return parts[0].recording.with_stretches(stretches)
