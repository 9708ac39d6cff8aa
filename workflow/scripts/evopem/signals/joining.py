"""Several recordings of one system as one: joined where they agree, refused where they do not."""

from __future__ import annotations

from collections.abc import Sequence

from evopem.errors import InputError
from evopem.signals.recording import Recording, concatenated
from evopem.signals.shared_samples import check_independent

# Rates from the time stamps of equal clocks differ by no more than this share.
RATE_TOLERANCE = 1e-4
_TWICE = "give every recording of the data set once"


def joined(recordings: Sequence[Recording], sources: Sequence[str]) -> Recording:
    """Recordings of one system as one, each with its own number.

    Parameters
    ----------
    recordings : sequence of Recording
        Each of one segment.
    sources : sequence of str
        Their files, for an error to name.

    Raises
    ------
    InputError
        When channels, units or sampling rates differ, or one holds the samples of another.
    """
    _check_alike(recordings, sources)
    _check_independent(recordings, sources)
    return concatenated(recordings)


def _check_alike(recordings: Sequence[Recording], sources: Sequence[str]) -> None:
    for other, source in zip(recordings[1:], sources[1:], strict=True):
        check_alike(recordings[0], other, sources[0], source)


def _check_independent(recordings: Sequence[Recording], sources: Sequence[str]) -> None:
    for number, (other, source) in enumerate(zip(recordings, sources, strict=True)):
        for earlier, earlier_source in zip(recordings[:number], sources, strict=False):
            check_independent(earlier, other, source, earlier_source, _TWICE)


def check_alike(first: Recording, other: Recording, first_source: str, source: str) -> None:
    """Refuse a recording of other channels, units or rate than the first one of a data set.

    Raises
    ------
    InputError
    """
    found = _in_common(other)
    for (what, key), expected in _in_common(first).items():
        own = found.get((what, key))
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


def _in_common(recording: Recording) -> dict[tuple[str, str], str]:
    """What recordings of one data set share, by what it is and the key that says it."""
    common: dict[tuple[str, str], str] = {}
    for role, names, units in (
        ("input", recording.input_names, recording.input_units),
        ("output", recording.output_names, recording.output_units),
    ):
        what = role if len(names) <= 1 else f"list of its {role}s"
        common[what, role] = ", ".join(names)
        for name, unit in zip(names, units, strict=True):
            called = role if len(names) == 1 else f"{role} {name}"
            common[f"unit of its {called}", f"{role}_unit"] = unit
    return common


def check_same_rate(recording: Recording, validation: Recording, source: str) -> None:
    """Refuse a validation recording of another rate than the estimation recording's."""
    if recording.sampling_rate != validation.sampling_rate:
        raise InputError(
            source,
            f"it was sampled at {validation.sampling_rate:g} Hz and the estimation recording at"
            f" {recording.sampling_rate:g} Hz",
            "validate on a recording of the same rate",
        )
