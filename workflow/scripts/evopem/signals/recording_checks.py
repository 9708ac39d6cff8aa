"""Refuse recordings from which nothing can be identified; how much of a signal is saturated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.recording import MINIMUM_SAMPLES, Recording

Array = NDArray[np.float64]

LARGEST = 1e60
"""A signal's largest magnitude must be below this and above its inverse: the squares of residuals
that are ten digits smaller, and the gain between two such signals, then stay finite."""

MAX_DESIGNED_LEVELS = 16
"""A signal of at most this many levels, such as a random telegraph, was made of levels."""

MIN_SATURATED_RUN = 3
"""This many equal samples in sequence at a signal's limit count as saturated."""

LARGEST_STUCK_SHARE = 0.9
"""A measured output with more than this share of its samples at one value, or at its two limits,
is refused. A smaller share is stated in the report."""

OVERFLOW_CODES = (9.9e37, 9.91e37, float(np.finfo(np.float32).max), 9.969209968386869e36)
"""Numbers for overflow and "not a number" in SCPI (1999, 7.2.1), the largest number of single
precision, and the value that netCDF fills in."""


def check_recording(
    recording: Recording, source: str = "recording", constant_input: bool = False
) -> None:
    """Refuse a recording from which no model can be identified.

    With ``constant_input`` inputs may rest: after a step or a blow a model can still be validated
    by its free response.
    """
    if len(recording.inputs) != recording.samples:
        raise InputError(
            source,
            f"the input has {len(recording.inputs)} samples and the output {recording.samples}",
            "choose two channels that were sampled together",
        )
    if recording.samples < MINIMUM_SAMPLES:
        raise InputError(
            source,
            f"there are only {recording.samples} samples",
            f"give a longer recording, of at least {MINIMUM_SAMPLES} samples",
        )
    inputs = recording.inputs.shape[1]
    for number, (channel, values) in enumerate(recording.signals.items()):
        _check_signal(values, source, channel, constant_input and number < inputs)
    if not (np.isfinite(recording.sampling_rate) and recording.sampling_rate > 0):
        raise InputError(
            source,
            f"the sampling rate is {recording.sampling_rate} Hz",
            "give a positive number of samples a second",
        )


def _check_signal(
    values: NDArray[np.float64], source: str, channel: str, may_be_constant: bool = False
) -> None:
    """Refuse samples that are not finite, never change, or cannot be squared."""
    finite = np.isfinite(values)
    if not finite.all():
        first = int(np.argmin(finite))
        raise InputError(
            source,
            f"the value is {values[first]}, not a finite number",
            "repair the recording or cut that part away",
            f"{channel}, sample {first + 1}",
        )
    if np.ptp(values) == 0.0:
        if may_be_constant:
            return
        raise InputError(
            source,
            f"every sample is {values[0]:g}, so there is nothing to identify",
            "choose a channel that varies",
            channel,
        )
    if not LARGEST**-1 < np.max(np.abs(values)) < LARGEST:
        raise InputError(
            source,
            f"the largest magnitude is {np.max(np.abs(values)):g}, with which the squares of"
            " small residuals leave the range of numbers",
            "record in another unit or scale the channel",
            channel,
        )


def check_measured(recording: Recording, source: str) -> None:
    """Refuse a measured recording with overflow codes or a stuck output.

    An input may have two levels only. An output that hardly ever changes is refused.
    """
    for place, signal in recording.signals.items():
        codes = np.isin(np.abs(signal), OVERFLOW_CODES)
        if codes.any():
            first = int(np.argmax(codes))
            raise InputError(
                source,
                f"the value is {signal[first]:g}, which instruments write for an overflow or a"
                " missing value",
                "repair the recording or cut that part away",
                f"{place}, sample {first + 1}",
            )
    several = len(recording.output_names) > 1
    for name, output in zip(recording.output_names, recording.outputs.T, strict=True):
        _check_stuck(output, source, f'output "{name}"', several)


def _check_stuck(output: Array, source: str, place: str, may_be_left_out: bool) -> None:
    values, counts = np.unique(output, return_counts=True)
    at_limits = np.count_nonzero((output == values[0]) | (output == values[-1])) / output.size
    usual = int(np.argmax(counts))
    for share, where in (
        (counts[usual] / output.size, f"are the same value, {values[usual]:g}"),
        (at_limits, f"lie at its smallest or largest value, {values[0]:g} or {values[-1]:g}"),
    ):
        if share > LARGEST_STUCK_SHARE:
            raise InputError(
                source,
                f"{100 * share:.1f} % of its samples {where}, so the channel was saturated, cut off"
                " or hardly ever changed",
                f"{'leave the channel out, ' if may_be_left_out else ''}record again within the"
                " range of the instrument, or cut that part away",
                place,
            )


def saturated_share(signal: NDArray[np.float64]) -> float:
    """Share of samples in runs of `MIN_SATURATED_RUN` or more at the smallest or largest value.

    0 for a signal of at most `MAX_DESIGNED_LEVELS` levels, and for one that is held for as long at
    most of its other values, such as random steps.
    """
    if np.unique(signal).size <= MAX_DESIGNED_LEVELS:
        return 0.0
    at_limit = (signal == signal.min()) | (signal == signal.max())
    starts = np.flatnonzero(np.diff(signal) != 0.0) + 1
    lengths = np.diff(np.concatenate(([0], starts, [signal.size])))
    stays = np.repeat(lengths >= MIN_SATURATED_RUN, lengths)
    if not at_limit.all() and stays[~at_limit].mean() > 0.5:
        return 0.0
    return float(np.mean(at_limit & stays))
