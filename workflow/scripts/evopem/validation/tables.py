"""The series behind a validation as tables, and in the units of the recording."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from evopem.arrays import Array, Flags
from evopem.signals.prepared_data import StretchOrigin, Transforms, measured_outputs
from evopem.signals.recording import Recording
from evopem.signals.transforms import box_cox, invert_box_cox
from evopem.validation.residual_tests import ResidualCorrelation
from evopem.validation.responses import Responses
from evopem.validation.scores import error_percent
from evopem.validation.validation import RecordedErrors, Validation


@dataclass(frozen=True, eq=False)
class RecordedSeries:
    """Validation outputs as recorded, with one-step prediction and simulation, (N, l) each."""

    outputs: Array
    predicted: Array
    simulated: Array


def recorded_series(
    transforms: Transforms, outputs: Array, predicted: Array, simulated: Array
) -> RecordedSeries:
    """Take the validation samples of a model back to the units of the recording.

    Differencing is monic: errors one step ahead are those of the differenced output.
    """
    origins = transforms.validation
    ends = np.cumsum([each.samples for each in origins], dtype=int)[:-1]
    series = outputs, predicted, simulated
    split = zip(*(np.split(each, ends) for each in series), strict=True)
    found = [_recorded(transforms, *each) for each in zip(origins, split, strict=True)]
    return RecordedSeries(*map(np.concatenate, zip(*found, strict=True)))


def _recorded(
    transforms: Transforms, origin: StretchOrigin, series: tuple[Array, ...]
) -> tuple[Array, Array, Array]:
    """One stretch in the units of the recording."""
    outputs, predicted, simulated = series

    def recorded(signals: Array) -> Array:
        return measured_outputs(transforms, origin, signals)[transforms.difference :]

    measured = level = recorded(outputs)
    if transforms.box_cox is not None:
        level = box_cox(measured, transforms.box_cox, transforms.shift)
    prediction = level - (outputs - predicted)
    if transforms.box_cox is not None:
        prediction = invert_box_cox(prediction, transforms.box_cox, transforms.shift)
    known = np.isfinite(simulated)
    simulation = np.where(known, recorded(np.where(known, simulated, outputs)), np.nan)
    return measured, prediction, simulation


def recorded_errors(
    transforms: Transforms, series: RecordedSeries, scored: Flags, output: int
) -> RecordedErrors:
    """Errors of one recorded output over the scored samples."""
    measured, predicted, simulated = (
        each[scored, output] for each in (series.outputs, series.predicted, series.simulated)
    )
    defined = np.isfinite(simulated)
    return RecordedErrors(
        prediction_error_percent=error_percent(measured, predicted),
        simulation_error_percent=(
            error_percent(measured[defined], simulated[defined]) if defined.any() else np.nan
        ),
        undefined_samples=int(np.sum(~defined)),
        integrations=transforms.difference,
    )


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
