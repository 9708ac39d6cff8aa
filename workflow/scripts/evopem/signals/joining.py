"""Several recordings of one system as one: joined where they agree, refused where they do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from evopem.errors import InputError
from evopem.signals.recording import Recording
from evopem.signals.shared_samples import check_independent

# Rates from the time stamps of equal clocks differ by no more than this share.
RATE_TOLERANCE = 1e-4
_TWICE = "give every recording of the data set once"
# What recordings of one data set have in common: in words, and the key that says it.
_COMMON = {
    "input_name": ("input", "input"),
    "output_name": ("output", "output"),
    "input_unit": ("unit of its input", "input_unit"),
    "output_unit": ("unit of its output", "output_unit"),
}


class Sampled(Protocol):
    """A recording of any number of channels."""

    @property
    def sampling_rate(self) -> float:
        """In Hz."""


def joined(recordings: Sequence[Recording], sources: Sequence[str]) -> Recording:
    """Recordings of one system as one, each with its own number.

    Parameters
    ----------
    recordings : sequence of Recording
        Each of one stretch.
    sources : sequence of str
        Their files, for an error to name.

    Raises
    ------
    InputError
        When channels, units or sampling rates differ, or one holds the samples of another.
    """
    first = recordings[0]
    for number, (other, source) in enumerate(zip(recordings, sources, strict=True)):
        if number:
            check_alike(first, other, sources[0], source)
        for earlier, earlier_source in zip(recordings[:number], sources, strict=False):
            check_independent(earlier, other, source, earlier_source, _TWICE)
    stretches = [
        replace(each.stretches[0], recording=number) for number, each in enumerate(recordings)
    ]
    return first.with_stretches(stretches)


def check_alike(first: Recording, other: Recording, first_source: str, source: str) -> None:
    """Refuse a recording of other channels, units or rate than the first one of a data set.

    Raises
    ------
    InputError
    """
    for attribute, (what, key) in _COMMON.items():
        own, expected = getattr(other, attribute), getattr(first, attribute)
        if own != expected:
            raise InputError(
                source,
                f'the {what} is "{own}" here and "{expected}" in {first_source}',
                f"name under {key} what all recordings of the data set have, or take this file out"
                " of it",
            )
    if abs(other.sampling_rate - first.sampling_rate) > RATE_TOLERANCE * first.sampling_rate:
        raise InputError(
            source,
            f"its sampling rate is {other.sampling_rate:g} Hz and that of {first_source}"
            f" {first.sampling_rate:g} Hz",
            "give recordings of one rate, or correct sampling_rate or time",
        )


def check_same_rate(recording: Sampled, validation: Sampled, source: str) -> None:
    """Refuse a validation recording of another rate than the estimation recording's."""
    if recording.sampling_rate != validation.sampling_rate:
        raise InputError(
            source,
            f"it was sampled at {validation.sampling_rate:g} Hz and the estimation recording at"
            f" {recording.sampling_rate:g} Hz",
            "validate on a recording of the same rate",
        )


def separated(recording: Recording) -> list[Recording]:
    """Each stretch of a recording as a recording by itself."""
    return [recording.with_stretches([replace(each, recording=0)]) for each in recording.stretches]
