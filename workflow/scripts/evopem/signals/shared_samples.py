"""Refuse to validate on samples that the model was estimated from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.recording import Recording


def check_independent(estimation: Recording, validation: Recording, source: str) -> None:
    """Refuse a validation recording that is a copy of the estimation recording, or of a part.

    Parameters
    ----------
    estimation, validation : Recording
    source : str
        Configuration key of the validation file, for an error to name.

    Raises
    ------
    InputError
        When all samples of the shorter recording follow each other in the longer one.
    """
    start = shared_start(_signals(estimation), _signals(validation))
    if start is None:
        return
    shorter = min(estimation.samples, validation.samples)
    part = f"samples {start + 1} to {start + shorter} of"
    if estimation.samples == validation.samples:
        problem = "its samples are those of the estimation recording"
    elif validation.samples == shorter:
        problem = f"its samples are {part} the estimation recording"
    else:
        problem = f"{part} it are the estimation recording"
    raise InputError(
        source, problem, "give an independent recording, or leave the key out to cut this one"
    )


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


def _signals(recording: Recording) -> NDArray[np.float64]:
    return np.column_stack([recording.input, recording.output])
