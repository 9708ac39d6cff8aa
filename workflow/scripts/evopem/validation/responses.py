"""Predicted and simulated responses of a model over the validation samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_states import (
    estimate_prediction_states,
    estimate_simulation_state,
    simulate_with_fitted_level,
)
from evopem.signals.preparation import PreparedData
from evopem.signals.recording import Recording
from evopem.validation.recorded_units import RecordedSeries

States = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Plant and noise state of a prediction."""


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
    states: States


def unscored_samples(model: PolynomialModel) -> int:
    """Samples at the start of a record whose residuals its states determine."""
    orders = model.orders
    return orders.first_residual + max(orders.nf, orders.noise_states)


def held_out_samples(
    model: PolynomialModel, prepared: PreparedData, states: States
) -> HeldOutSamples:
    """Both parts where they are continuous, else the validation samples from own states."""
    estimation, validation = prepared.estimation, prepared.validation
    if prepared.contiguous:
        return HeldOutSamples(
            np.concatenate([estimation.input, validation.input]),
            np.concatenate([estimation.output, validation.output]),
            estimation.samples,
            states,
        )
    own = estimate_prediction_states(model, validation.input, validation.output)
    return HeldOutSamples(validation.input, validation.output, unscored_samples(model), own)


def responses_of(
    model: PolynomialModel,
    prepared: PreparedData,
    held_out: HeldOutSamples,
    free_level: bool = False,
) -> Responses:
    """Predict and simulate the validation samples.

    The prediction of samples that follow the estimation samples directly knows all the past.  With
    a free level the simulation fits its level to the validation samples, too.
    """
    estimation, validation = prepared.estimation, prepared.validation
    seen = len(held_out.output) - len(validation.output)
    continued = None
    if prepared.contiguous and model.has_input:
        state = estimate_simulation_state(model, estimation.input, estimation.output)
        continued = model.simulate(held_out.input, state)[seen:]
    predicted = model.predict(held_out.input, held_out.output, 1, *held_out.states)[seen:]
    return Responses(
        input=validation.input,
        output=validation.output,
        predicted=predicted,
        simulated=_simulated(model, validation, free_level),
        continued=continued,
        unscored=0 if prepared.contiguous else unscored_samples(model),
    )


def _simulated(
    model: PolynomialModel, validation: Recording, free_level: bool
) -> NDArray[np.float64]:
    """Response to the validation input from the state that fits the validation output best."""
    if not model.has_input:
        return np.full(len(validation.output), np.nan)
    if free_level:
        return simulate_with_fitted_level(model, validation.input, validation.output)
    state = estimate_simulation_state(model, validation.input, validation.output)
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
