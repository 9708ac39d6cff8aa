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
    """Errors in the units of the recording, over the scored validation samples.

    Attributes
    ----------
    prediction_error_percent, simulation_error_percent : float
        ``100 ||y - yhat|| / ||y - mean(y)||``; NaN where no sample is defined.
    undefined_samples : int
        Simulated samples that leave the range of the Box-Cox transform and have no recorded value.
    integrations : int
        Number of times that the inverse of differencing sums up the error of the simulation. From
        1 on this error drifts, and its percentage grows with the length of the record.
    """

    prediction_error_percent: float
    simulation_error_percent: float
    undefined_samples: int
    integrations: int


@dataclass(frozen=True, eq=False)
class RecordedSeries:
    """Validation output as recorded, with its one-step prediction and simulation, (N,) each."""

    output: Array
    predicted: Array
    simulated: Array


def recorded_series(
    transforms: Transforms, output: Array, predicted: Array, simulated: Array
) -> RecordedSeries:
    """Take the validation samples of a model back to the units of the recording.

    The one-step prediction uses the measured past in recorded units as well: differencing is
    monic, so its errors are those of the differenced output.

    Parameters
    ----------
    transforms : Transforms
    output, predicted, simulated : (N,) arrays
        Prepared validation samples; NaN where there is none.
    """
    ends = np.cumsum([each.samples for each in transforms.validation], dtype=int)[:-1]
    split = [np.split(each, ends) for each in (output, predicted, simulated)]
    stretches = zip(transforms.validation, *split, strict=True)
    found = [_recorded(transforms, *each) for each in stretches]
    return RecordedSeries(
        np.concatenate([each.output for each in found]),
        np.concatenate([each.predicted for each in found]),
        np.concatenate([each.simulated for each in found]),
    )


def _recorded(
    transforms: Transforms, origin: StretchOrigin, output: Array, predicted: Array, simulated: Array
) -> RecordedSeries:
    """One stretch in the units of the recording."""

    def recorded(signal: Array) -> Array:
        return measured_outputs(transforms, origin, signal[:, None])[transforms.difference :, 0]

    measured = recorded(output)
    level = measured
    if transforms.box_cox is not None:
        level = box_cox(measured, transforms.box_cox, transforms.shift)
    prediction = level - (output - predicted)
    if transforms.box_cox is not None:
        prediction = invert_box_cox(prediction, transforms.box_cox, transforms.shift)
    known = np.where(np.isfinite(simulated), simulated, output)
    simulation = recorded(known)
    simulation[~np.isfinite(simulated)] = np.nan
    return RecordedSeries(measured, prediction, simulation)


def recorded_errors(
    transforms: Transforms, series: RecordedSeries, scored: NDArray[np.bool_]
) -> RecordedErrors:
    """Errors of the recorded series over the scored samples."""
    measured = series.output[scored]
    simulated = series.simulated[scored]
    defined = np.isfinite(simulated)
    return RecordedErrors(
        prediction_error_percent=error_percent(measured, series.predicted[scored]),
        simulation_error_percent=(
            error_percent(measured[defined], simulated[defined]) if defined.any() else np.nan
        ),
        undefined_samples=int(np.sum(~defined)),
        integrations=transforms.difference,
    )
