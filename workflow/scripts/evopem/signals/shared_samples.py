"""Refuse to validate on samples that the model was estimated from."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.recording import Recording, Segment


def check_independent(
    estimation: Recording,
    validation: Recording,
    source: str,
    other: str = "the estimation recording",
    remedy: str = "give an independent recording, or leave the key out to cut this one",
) -> None:
    """Refuse a recording that is a copy of another one, or of a part.

    Parameters
    ----------
    estimation, validation : Recording
        Of several stretches, each is compared with each.
    source : str
        Configuration key of the validation file, for an error to name.
    other : str
        What the estimation recording is called.
    remedy : str
        What to do.

    Raises
    ------
    InputError
        When all samples of the shorter recording follow each other in the longer one.
    """
    for one, two in itertools.product(estimation.segments, validation.segments):
        problem = _shared(one, two, other)
        if problem:
            raise InputError(source, problem, remedy)


def _shared(estimation: Segment, validation: Segment, other: str) -> str:
    """What two stretches have in common, in words; empty where nothing."""
    start = shared_start(_signals(estimation), _signals(validation))
    if start is None:
        return ""
    shorter = min(estimation.samples, validation.samples)
    part = f"samples {start + 1} to {start + shorter} of"
    if estimation.samples == validation.samples:
        return f"its samples are those of {other}"
    if validation.samples == shorter:
        return f"its samples are {part} {other}"
    return f"{part} it are {other}"


def shared_start(one: NDArray[np.float64], other: NDArray[np.float64]) -> int | None:
    """Find where all rows of the shorter array stand in the longer one; None where nowhere.

    Parameters
    ----------
    one, other : ndarray, shape (n, channels) and (m, channels)
    """
    shorter, longer = sorted((one + 0.0, other + 0.0), key=len)  # no -0.0, whose bits differ
    # Searching bytes takes a time proportional to their number, however often samples repeat.
    width = shorter.itemsize * shorter.shape[1]
    content, sought = longer.tobytes(), shorter.tobytes()
    place = content.find(sought)
    while place % width > 0:  # between two samples; the modulus of -1 is positive as well
        if place < 0:
            return None
        place = content.find(sought, place + 1)
    return place // width


def _signals(recording: Segment) -> NDArray[np.float64]:
    return np.column_stack([recording.inputs, recording.outputs])
