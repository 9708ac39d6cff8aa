"""The errors of prediction and simulation, of every output and of every recording."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from evopem.report.section import Material, Section
from evopem.results.dataset import DatasetResults


@dataclass(frozen=True)
class RecordingRow:
    """A recording of several."""

    file: str
    samples: int  # as recorded
    estimation: int  # prepared samples for either
    validation: int
    # On its validation samples, mean over the outputs: of simulations, without an input of
    # predictions; NaN without validation samples.
    error_percent: float


def recording_rows(results: DatasetResults) -> list[RecordingRow]:
    """One row for each recording, in their order; none where there is only one."""
    transforms, has_input = results.model.transforms, bool(results.model.input_names)
    used = {each.recording: each.samples for each in transforms.estimation}
    held_out = {each.recording: each.samples for each in transforms.validation}
    errors = {
        number: each.simulation_error_percent if has_input else each.prediction_error_percent
        for number, each in zip(held_out, results.validation.stretches, strict=False)
    }
    return [
        RecordingRow(
            file.path,
            file.samples,
            used.get(number, 0),
            held_out.get(number, 0),
            errors.get(number, math.nan),
        )
        for number, file in enumerate(results.files if transforms.several_recordings else ())
    ]


def _content(material: Material) -> dict[str, Any]:
    view = material.view
    return {
        "figures": material.figures_of("errors"),
        "outputs": [errors for _, errors in view.worst_first],
        "recordings": recording_rows(view.results),
    }


SECTION = Section(
    "errors",
    lambda view: "Prediction and simulation" if view.has_input else "Prediction",
    _content,
)
