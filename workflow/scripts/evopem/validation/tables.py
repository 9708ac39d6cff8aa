"""The series behind a validation as tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evopem.signals.recording import Recording
from evopem.validation.recorded_units import RecordedSeries
from evopem.validation.residual_tests import ResidualCorrelation
from evopem.validation.responses import Responses
from evopem.validation.validation import Validation

Array = NDArray[np.float64]


def autocorrelation_table(
    names: Sequence[str], found: Sequence[ResidualCorrelation]
) -> pd.DataFrame:
    """Autocorrelations of the residuals of all outputs, one below the other."""
    columns = ["output", "lag", "autocorrelation", "bound95"]
    tables = [
        each.table("autocorrelation").assign(output=name)[columns]
        for name, each in zip(names, found, strict=True)
    ]
    return pd.concat(tables, ignore_index=True)


def horizon_table(validation: Validation, sampling_rate: float) -> pd.DataFrame:
    """The errors by output and by horizon, in samples and in seconds."""
    horizons = np.array(validation.horizons)
    tables = [
        pd.DataFrame(
            {
                "output": each.name,
                "horizon": horizons,
                "horizon_s": horizons / sampling_rate,
                "error_percent": each.horizon_errors_percent,
            }
        )
        for each in validation.outputs
    ]
    return pd.concat(tables, ignore_index=True)


def simulation_table(
    validation: Recording, responses: Responses, recorded: RecordedSeries
) -> pd.DataFrame:
    """Validation samples, time from the first of each stretch; unscored computed ones missing."""
    samples = [np.arange(each.samples) for each in validation.separated]
    columns: dict[str, Array] = {"time_s": np.concatenate(samples) / validation.sampling_rate}
    if validation.is_joined:
        numbers = np.arange(len(samples)) + 1
        columns = {"recording": np.repeat(numbers, [each.size for each in samples]), **columns}
    for k, name in enumerate(validation.input_names):
        columns[f"input_{name}"] = validation.inputs[:, k]

    def scored(series: Array, k: int) -> Array:
        return np.where(responses.scored, series[:, k], np.nan)

    for k, name in enumerate(validation.output_names):
        measured = responses.outputs[:, k]
        predicted, simulated = scored(responses.predicted, k), scored(responses.simulated, k)
        columns |= {
            f"output_{name}": measured,
            f"simulated_{name}": simulated,
            f"predicted_{name}": predicted,
            f"simulation_error_{name}": measured - simulated,
            f"prediction_error_{name}": measured - predicted,
            f"recorded_output_{name}": recorded.outputs[:, k],
            f"recorded_simulated_{name}": scored(recorded.simulated, k),
            f"recorded_predicted_{name}": scored(recorded.predicted, k),
        }
    return pd.DataFrame(columns)
