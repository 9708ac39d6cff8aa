"""The frequency response of a model of several channels beside the measured one, as a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from evopem.estimation.model_record import ModelRecord
from evopem.models.state_space_tables import gain_intervals
from evopem.signals.recording import Recording
from evopem.signals.spectral.frequency_response import frequency_response

NFFT = 1024


def frequency_response_rows(
    record: ModelRecord, estimation: Recording
) -> dict[str, list[Any]]:
    """Gains and phases of every pair of output and input, the model's and the measured ones.

    One row for each frequency of each pair; without an input none.

    ``estimation``: samples behind the measured response.
    """
    names = (
        *("frequency_hz", "output", "input", "gain", "gain_lower", "gain_upper", "phase_deg"),
        *("measured_gain", "measured_phase_deg", "coherence"),
    )
    rows: dict[str, list[Any]] = {name: [] for name in names}
    if not estimation.has_input:
        return rows
    plant = record.plant
    # Enough tapers for the spectral matrix of the inputs to be inverted.
    width = max(4.0, 2.0 * len(record.input_names) + 1.0)
    measured = frequency_response(estimation, min(width, estimation.longest.samples / 4.0), NFFT)
    response = plant.frequency_response(measured.frequencies)
    lower, upper = gain_intervals(plant, measured.frequencies)
    phase = np.degrees(np.unwrap(np.angle(response), axis=0))
    count = len(measured.frequencies)
    for row, output in enumerate(record.output_names):
        for column, input_ in enumerate(record.input_names):
            own = measured.response[:, row, column]
            rows["output"] += [output] * count
            rows["input"] += [input_] * count
            for name, values in (
                ("frequency_hz", measured.frequencies),
                ("gain", np.abs(response[:, row, column])),
                ("gain_lower", lower[:, row, column]),
                ("gain_upper", upper[:, row, column]),
                ("phase_deg", phase[:, row, column]),
                ("measured_gain", np.abs(own)),
                ("measured_phase_deg", np.degrees(np.angle(own))),
                ("coherence", measured.coherence[:, row]),
            ):
                rows[name] += values.tolist()
    return rows
