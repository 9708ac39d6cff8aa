"""The recordings of a data set with several channels: what each is used for, and its errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

from evopem.results.multichannel import MultichannelResults


@dataclass(frozen=True)
class RecordingRow:
    """A recording of several.

    Attributes
    ----------
    file : str
    samples : int
        As recorded.
    estimation, validation : int
        Prepared samples for either.
    error_percent : float
        On its validation samples, mean over the outputs: of simulations, without an input of
        predictions; NaN without validation samples.
    """

    file: str
    samples: int
    estimation: int
    validation: int
    error_percent: float


def recording_rows(results: MultichannelResults) -> list[RecordingRow]:
    """One row for each recording, in their order; none where there is only one."""
    transforms, has_input = results.model.transforms, bool(results.model.input_names)
    used = {each.recording: each.samples for each in transforms.estimation_records}
    held_out = {each.recording: each.samples for each in transforms.validation_records}
    errors = {
        number: each.simulation_error_percent if has_input else each.prediction_error_percent
        for number, each in zip(held_out, results.validation.recordings, strict=False)
    }
    return [
        RecordingRow(
            file.path,
            file.samples,
            used.get(number, 0),
            held_out.get(number, 0),
            errors.get(number, math.nan),
        )
        for number, file in enumerate(results.files if used else ())
    ]
