"""Parts of recordings: which samples they are, transformed outputs, differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import SplitSettings, TransformSettings
from evopem.errors import InputError
from evopem.signals.prepared_data import Source
from evopem.signals.recording import Recording
from evopem.signals.transforms import box_cox, likeliest_box_cox, positive_shift

Range = tuple[int, int, int]
"""A recording, its first sample and the one after its last."""


@dataclass(frozen=True)
class Ranges:
    """The samples for estimation and for validation, and where the latter come from."""

    estimation: list[Range]
    validation: list[Range]
    source: Source

    def of(self, part: str) -> list[Range]:
        """Those of estimation or validation."""
        return self.estimation if part == "estimation" else self.validation


def prepared_samples(place: str, recorded: Sequence[str], number: int) -> str:
    """What an error calls the prepared samples of a recording, by its file where it is known.

    ``place`` is the key of the part, such as ``datasets.arm.validation``; ``recorded`` are all
    files.
    """
    name = recorded[number] if recorded else f"recording {number + 1}"
    return f"{place} (the samples of {name} as prepared)"


def check_differences(transforms: TransformSettings, source: str) -> None:
    """Refuse numbers of differences that are none."""
    for name in ("difference", "difference_input"):
        count = getattr(transforms, name)
        if not isinstance(count, int) or isinstance(count, bool) or count < 0:
            raise InputError(
                f"{source}.{name}",
                f"{count!r} is not a number of differences",
                "give a whole number of at least 0",
            )


def estimation_range(
    available: int, split: SplitSettings, cut: bool, source: str
) -> tuple[int, int]:
    """First estimation sample and the one after the last, among the differenced samples."""
    if available < 1:
        raise InputError(
            source,
            "the differences leave no sample of the recording",
            "difference less often or give a longer recording",
        )
    first = discarded(available, split, source)
    remaining = available - first
    chosen = split.estimation
    key = f"{source}.estimation"
    if not cut and isinstance(chosen, float) and chosen == 1.0:
        return first, available
    samples = _number_of_samples(chosen, remaining, key, smallest=1)
    if samples > remaining:
        raise InputError(
            key,
            f"{samples} samples are asked for and {remaining} remain after the discarded ones",
            "ask for fewer samples or a share such as 0.8",
        )
    if cut and samples == remaining:
        raise InputError(
            key,
            f"all {remaining} samples are asked for, so none remain to validate on",
            "ask for fewer samples or name a validation_file",
        )
    return first, first + samples


def held_out_recordings(samples: Sequence[int], share: float) -> int:
    """How many of the last recordings hold about a share of all samples; at least one."""
    held = np.cumsum(samples[:0:-1])
    return int(np.argmin(np.abs(held - share * sum(samples)))) + 1


def divided_ranges(
    records: Sequence[Recording], own: int, split: SplitSettings, lost: int, key: str
) -> Ranges:
    """The samples of recordings for estimation and for validation.

    The records of files for validation stand last, after the ``own`` ones of the data set; ``lost``
    first samples of each go to its differences.
    """
    lengths = [each.samples for each in records]
    every = range(len(lengths))

    def whole(number: int) -> Range:
        samples = lengths[number]
        return number, lost + discarded(samples - lost, split, key), samples

    def cut(number: int, cuts: bool = True) -> Range:
        start, stop = estimation_range(lengths[number] - lost, split, cuts, key)
        return number, start + lost, stop + lost

    if own == len(lengths) == 1:
        _, start, stop = cut(0)
        if split.estimation == SplitSettings().estimation and records[0].has_input:
            stop = lost + before_last_change(records[0].inputs[lost:], start - lost, stop - lost)
        return Ranges([(0, start, stop)], [(0, stop, lengths[0])], "cut")
    if own < len(lengths):
        estimation = [cut(0, False)] if len(lengths) == 2 else [whole(n) for n in every[:own]]
        return Ranges(estimation, [whole(n) for n in every[own:]], "file")
    if split.by == "recordings":
        kept = own - held_out_recordings(lengths, 1.0 - split.estimation)
        return Ranges(
            [whole(n) for n in every[:kept]], [whole(n) for n in every[kept:]], "recordings"
        )
    estimation = [cut(n) for n in every]
    return Ranges(estimation, [(n, stop, lengths[n]) for n, _, stop in estimation], "cut")


def before_last_change(inputs: NDArray[np.float64], first: int, stop: int) -> int:
    """Where the validation samples begin when the built-in share is to test the inputs' response.

    That is `stop`, the sample after the last estimation sample by the built-in share, unless all
    inputs, (N, m), rest from there on. Then it is a tenth of the samples before their last change,
    so that the state before it can be told from the response to it. At least half of the samples
    have to remain for estimation, and an input has to change among them: of a sequence of steps the
    last one is held out. After a single step or blow it stays `stop`.
    """
    if np.ptp(inputs[stop:], axis=0).any():
        return stop
    changes = first + np.flatnonzero(np.diff(inputs[first : stop + 1], axis=0).any(axis=1))
    available = len(inputs) - first
    begin = int(changes[-1]) - available // 10 if changes.size else first
    if 2 * (begin - first) < available or changes[0] + 1 >= begin:
        return stop
    return begin


def discarded(available: int, split: SplitSettings, source: str) -> int:
    """Number of samples to leave out at the start of `available` ones."""
    key = f"{source}.discard"
    discard = _number_of_samples(split.discard, available, key, smallest=0)
    if discard >= available:
        raise InputError(
            key,
            f"{discard} samples are to be discarded and there are only {available}",
            "discard fewer samples",
        )
    return discard


def _number_of_samples(value: float, available: int, source: str, smallest: int) -> int:
    """Turn a number of samples (int) or a share (float between 0 and 1) into samples."""
    if isinstance(value, int) and not isinstance(value, bool) and value >= smallest:
        return value
    if isinstance(value, float) and 0.0 < value < 1.0:
        return max(smallest, round(value * available))
    raise InputError(
        source,
        f"{value!r} is neither a number of samples nor a share",
        f"give a whole number from {smallest} or a fraction between 0 and 1",
    )


def transform_outputs(
    records: list[Recording],
    setting: float | str,
    estimation: Sequence[tuple[int, int, int]],
    source: str,
) -> tuple[list[Recording], float | None, float]:
    """Box-Cox transform the outputs of all records alike: records, parameter, shift.

    An automatic parameter is found from the ``estimation`` samples.
    """
    if setting == "none":
        return records, None, 0.0
    outputs = records[0].outputs.shape[1]
    if outputs > 1:
        raise InputError(
            source,
            f"the Box-Cox transform bends the scale of one output, and there are {outputs}",
            "use box_cox: none",
        )
    shift = positive_shift(*(record.output for record in records))
    if setting == "auto":
        known = [records[number].output[start:stop] for number, start, stop in estimation]
        parameter = likeliest_box_cox(np.concatenate(known), shift, source)
    elif isinstance(setting, int | float) and not isinstance(setting, bool):
        parameter = float(setting)
    else:
        raise InputError(
            source, f"{setting!r} is not a Box-Cox parameter", 'give a number, "auto" or "none"'
        )
    transformed = [
        replace(record, outputs=box_cox(record.output, parameter, shift, source))
        for record in records
    ]
    return transformed, parameter, shift
