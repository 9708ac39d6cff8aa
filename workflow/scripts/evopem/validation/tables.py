"""Errors in percent, and the series behind a validation, also in the units of the recording."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from evopem.arrays import Array
from evopem.signals.prepared_data import StretchOrigin, Transforms, measured_outputs
from evopem.signals.recording import Recording
from evopem.signals.transforms import box_cox, invert_box_cox
from evopem.validation.residual_tests import ResidualCorrelation
from evopem.validation.responses import Responses
from evopem.validation.validation import RecordedErrors, Validation


def error_percent(measured: ArrayLike, computed: ArrayLike) -> float:
    """Relative error ``100 ||y - yhat|| / ||y - mean(y)||`` in percent; NaN when y is constant.

    0 is perfect, 100 is as good as the mean of y, more is worse than it.
    """
    y, y_hat = np.asarray(measured, dtype=float), np.asarray(computed, dtype=float)
    reference = _norm(y - y.mean())
    return 100.0 * _norm(y - y_hat) / reference if reference > 0 else math.nan


def outlier_percent(residuals: ArrayLike) -> float:
    """Percentage of residuals beyond five robust standard deviations of their median.

    Of normal residuals one in two million lies so far out.
    """
    e = np.asarray(residuals, dtype=float)
    distance = np.abs(e - np.median(e))
    return float(100.0 * np.mean(distance > 5.0 * 1.4826 * np.median(distance)))


def _norm(values: Array) -> float:
    """Euclidean norm, also of numbers whose squares leave the range of floats. An unstable response
    that is transformed back to recorded units may reach these."""
    _, exponent = np.frexp(np.max(np.abs(values), initial=0.0))
    scaled = np.linalg.norm(np.ldexp(values, -exponent))  # a power of two keeps every bit
    return float(np.ldexp(scaled, exponent))


def recorded_series(transforms: Transforms, responses: Responses) -> Responses:
    """Outputs, predictions and simulations in the units of the recording.

    Differencing is monic: errors one step ahead are those of the differenced output.
    """
    origins = transforms.validation
    ends = np.cumsum([origin.samples for origin in origins], dtype=int)[:-1]
    series = responses.outputs, responses.predicted, responses.simulated
    split = zip(*(np.split(curve, ends) for curve in series), strict=True)
    stretches = [_recorded(transforms, *part) for part in zip(origins, split, strict=True)]
    outputs, predicted, simulated = map(np.concatenate, zip(*stretches, strict=True))
    return replace(responses, outputs=outputs, predicted=predicted, simulated=simulated)


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


def recorded_errors(transforms: Transforms, recorded: Responses, output: int) -> RecordedErrors:
    """Errors of one recorded output over the scored samples."""
    measured, predicted, simulated = (
        signal[recorded.scored, output]
        for signal in (recorded.outputs, recorded.predicted, recorded.simulated)
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


def correlation_table(
    value: str, role: Sequence[str], pairs: Sequence[tuple[Sequence[str], ResidualCorrelation]]
) -> pd.DataFrame:
    """Correlations below each other, each beside the names of its channels in their roles."""
    columns = [*role, "lag", value, "bound95"]
    tables = [
        correlation.table(value).assign(**dict(zip(role, names, strict=True)))[columns]
        for names, correlation in pairs
    ]
    return pd.concat(tables or [pd.DataFrame(columns=columns)], ignore_index=True)


def horizon_table(validation: Validation, sampling_rate: float) -> pd.DataFrame:
    """The errors by output and by horizon, in samples and in seconds."""
    rows = [
        (output.name, horizon, horizon / sampling_rate, error)
        for output in validation.outputs
        for horizon, error in zip(validation.horizons, output.horizon_errors_percent, strict=True)
    ]
    return pd.DataFrame(rows, columns=["output", "horizon", "horizon_s", "error_percent"])


def simulation_table(
    validation: Recording, responses: Responses, recorded: Responses
) -> pd.DataFrame:
    """Validation samples, time from the first of each stretch; unscored computed ones missing."""
    samples = [np.arange(record.samples) for record in validation.separated]
    columns: dict[str, Array] = {"time_s": np.concatenate(samples) / validation.sampling_rate}
    if validation.is_joined:
        numbers = np.arange(len(samples)) + 1
        columns = {"recording": np.repeat(numbers, [sample.size for sample in samples]), **columns}
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
