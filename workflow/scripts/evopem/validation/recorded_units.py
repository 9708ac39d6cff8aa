"""Prediction and simulation in the units of the recording, before all transforms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.signals.prepared_data import StretchOrigin, Transforms, measured_outputs
from evopem.signals.transforms import box_cox, invert_box_cox
from evopem.validation.scores import error_percent

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RecordedErrors:
    """Errors of an output in the units of the recording, over the scored validation samples."""

    # prediction_error_percent, simulation_error_percent: ``100 ||y - yhat|| / ||y - mean(y)||``;
    # NaN where no sample is defined
    prediction_error_percent: float
    simulation_error_percent: float
    # Simulated samples that leave the range of the Box-Cox transform and have no recorded value
    undefined_samples: int
    # Number of times that the inverse of differencing sums up the error of the simulation. From 1
    # on this error drifts, and its percentage grows with the length of the record
    integrations: int


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

    The one-step prediction uses the measured past in recorded units as well: differencing is
    monic, so its errors are those of the differenced output.
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
    transforms: Transforms, series: RecordedSeries, scored: NDArray[np.bool_], output: int
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
