"""Predicted and simulated responses of a model over the validation samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel
from evopem.models.initial_state import estimate_initial_state, estimate_noise_state
from evopem.signals.preparation import PreparedData
from evopem.signals.recording import Recording
from evopem.validation.recorded_units import RecordedSeries


@dataclass(frozen=True)
class Responses:
    """Validation samples with the two computed responses; ``nan`` where there is none."""

    input: NDArray[np.float64]
    output: NDArray[np.float64]
    predicted: NDArray[np.float64]
    simulated: NDArray[np.float64]
    continued: NDArray[np.float64] | None
    unscored: int


@dataclass(frozen=True)
class HeldOutSamples:
    """Signals that end with samples that the model was not estimated from, from ``first`` on."""

    input: NDArray[np.float64]
    output: NDArray[np.float64]
    first: int
    noise_state: NDArray[np.float64]


def held_out_samples(
    model: PolynomialModel, prepared: PreparedData, noise_state: NDArray[np.float64]
) -> HeldOutSamples:
    estimation, validation = prepared.estimation, prepared.validation
    if prepared.contiguous:
        return HeldOutSamples(
            np.concatenate([estimation.input, validation.input]),
            np.concatenate([estimation.output, validation.output]),
            estimation.samples,
            noise_state,
        )
    first = model.orders.first_residual + model.orders.nc
    own_state = estimate_noise_state(model, validation.input, validation.output)
    return HeldOutSamples(validation.input, validation.output, first, own_state)


def continued_responses(
    model: PolynomialModel, prepared: PreparedData, noise_state: NDArray[np.float64]
) -> Responses:
    """Predict and simulate validation samples that follow the estimation samples directly."""
    estimation, validation = prepared.estimation, prepared.validation
    inputs = np.concatenate([estimation.input, validation.input])
    output = np.concatenate([estimation.output, validation.output])
    seen = estimation.output.size
    state = estimate_initial_state(model, estimation.input, estimation.output)
    return Responses(
        input=validation.input,
        output=validation.output,
        predicted=model.predict(inputs, output, noise_state)[seen:],
        simulated=_simulated(model, validation),
        continued=model.simulate(inputs, state)[seen:],
        unscored=0,
    )


def restarted_responses(model: PolynomialModel, prepared: PreparedData) -> Responses:
    """Predict and simulate an independent recording, whose past is not on record."""
    validation = prepared.validation
    noise_state = estimate_noise_state(model, validation.input, validation.output)
    return Responses(
        input=validation.input,
        output=validation.output,
        predicted=model.predict(validation.input, validation.output, noise_state),
        simulated=_simulated(model, validation),
        continued=None,
        unscored=model.orders.first_residual + model.orders.nc,
    )


def _simulated(model: PolynomialModel, validation: Recording) -> NDArray[np.float64]:
    """Response to the validation input from the state that fits the validation output best."""
    state = estimate_initial_state(model, validation.input, validation.output)
    return model.simulate(validation.input, state)


def simulation_table(
    responses: Responses, recorded: RecordedSeries, sampling_rate: float
) -> pd.DataFrame:
    """Validation samples, time from their first; unscored computed values are missing."""
    predicted = _scored(responses.predicted, responses.unscored)
    simulated = _scored(responses.simulated, responses.unscored)
    return pd.DataFrame(
        {
            "time_s": np.arange(responses.output.size) / sampling_rate,
            "input": responses.input,
            "output": responses.output,
            "simulated": simulated,
            "predicted": predicted,
            "simulation_error": responses.output - simulated,
            "prediction_error": responses.output - predicted,
            "recorded_output": recorded.output,
            "recorded_simulated": _scored(recorded.simulated, responses.unscored),
            "recorded_predicted": _scored(recorded.predicted, responses.unscored),
        }
    )


def _scored(series: NDArray[np.float64], unscored: int) -> NDArray[np.float64]:
    """The series without its unscored samples, which are NaN."""
    kept = series.copy()
    kept[:unscored] = np.nan
    return kept
