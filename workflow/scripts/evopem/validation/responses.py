"""Predicted and simulated responses of a model over the validation samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_states import (
    estimate_level,
    estimate_prediction_states,
    estimate_simulation_state,
    first_samples,
    simulate_from_first,
    simulate_with_fitted_level,
)
from evopem.signals.prepared_data import PreparedData
from evopem.signals.recording import Segment
from evopem.validation.recorded_units import RecordedSeries

States = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Plant and noise state of a prediction."""


@dataclass(frozen=True)
class Responses:
    """Validation samples with the two computed responses; ``nan`` where there is none.

    ``simulated`` runs on from what came before, ``fitted`` from the state that fits these samples.
    ``scored`` tells which samples count: not those that initial states determine.
    """

    input: NDArray[np.float64]
    output: NDArray[np.float64]
    predicted: NDArray[np.float64]
    simulated: NDArray[np.float64]
    fitted: NDArray[np.float64]
    scored: NDArray[np.bool_]


@dataclass(frozen=True)
class HeldOutSamples:
    """Signals that end with samples that the model was not estimated from, from ``first`` on.

    ``samples`` are those of the validation part; ``model`` has the level of this stretch.
    """

    model: PolynomialModel
    input: NDArray[np.float64]
    output: NDArray[np.float64]
    first: int
    samples: int
    states: States


def unscored_samples(model: PolynomialModel) -> int:
    """Samples at the start of a record whose residuals its states determine."""
    orders = model.orders
    return orders.first_residual + max(orders.single.nf, orders.noise_states)


def held_out_samples(
    model: PolynomialModel, prepared: PreparedData, free_level: bool = False
) -> tuple[HeldOutSamples, ...]:
    """Both parts where they are continuous, else each validation stretch from own states.

    With a free level each validation stretch has one of its own, fitted along with its states.
    """
    before, validation = prepared.before_validation, prepared.validation
    if before is not None:
        return tuple(
            HeldOutSamples(
                model,
                np.concatenate([known.input, held_out.input]),
                np.concatenate([known.output, held_out.output]),
                known.samples,
                held_out.samples,
                estimate_prediction_states(model, known.input, known.output),
            )
            for known, held_out in zip(before.segments, validation.segments, strict=True)
        )
    own_level = free_level and prepared.transforms.several_recordings
    return tuple(_held_out(model, each, own_level) for each in validation.segments)


def _held_out(model: PolynomialModel, stretch: Segment, own_level: bool) -> HeldOutSamples:
    u, y = stretch.input, stretch.output
    if own_level:
        model = replace(model, level=estimate_level(model, u, y))
    states = estimate_prediction_states(model, u, y)
    return HeldOutSamples(model, u, y, unscored_samples(model), stretch.samples, states)


def responses_of(
    model: PolynomialModel,
    prepared: PreparedData,
    held_out: Sequence[HeldOutSamples],
    free_level: bool = False,
) -> Responses:
    """Predict and simulate the validation samples.

    The prediction of samples that follow the estimation samples directly knows all the past, and
    their simulation runs on from the estimation samples, which determine its state.  In other
    recordings the first samples determine the state, and are not scored.  With a free level a
    constant is fitted to the scored samples.
    """
    validation, is_continued = prepared.validation, prepared.before_validation is not None
    predicted = [
        each.model.predict(each.input, each.output, 1, *each.states)[-each.samples :]
        for each in held_out
    ]
    fitted = [_fitted(model, each, free_level) for each in validation.segments]
    unscored = [
        0 if is_continued else max(unscored_samples(model), first_samples(s.samples))
        for s in held_out
    ]
    simulated = [
        _simulated(model, *each, free_level) for each in zip(held_out, unscored, strict=True)
    ]
    return Responses(
        input=validation.input,
        output=validation.output,
        predicted=np.concatenate(predicted),
        simulated=np.concatenate(simulated),
        fitted=np.concatenate(fitted),
        scored=np.concatenate(
            [np.arange(s.samples) >= first for s, first in zip(held_out, unscored, strict=True)]
        ),
    )


def _simulated(
    model: PolynomialModel, held_out: HeldOutSamples, unscored: int, free_level: bool
) -> NDArray[np.float64]:
    """Response to the validation input from the state that the samples before make probable."""
    u, y, samples = held_out.input, held_out.output, held_out.samples
    if not model.has_input:
        return np.full(samples, np.nan)
    known = max(len(y) - samples + unscored, 1)
    found = simulate_from_first(model, u, y, known, free_level)
    if free_level:
        found = found + np.mean((y - found)[known:])
    return found[-samples:]


def _fitted(model: PolynomialModel, validation: Segment, free_level: bool) -> NDArray[np.float64]:
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
    predicted = _scored(responses.predicted, responses.scored)
    simulated = _scored(responses.simulated, responses.scored)
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
            "recorded_simulated": _scored(recorded.simulated, responses.scored),
            "recorded_predicted": _scored(recorded.predicted, responses.scored),
        }
    )


def _scored(series: NDArray[np.float64], scored: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The series with NaN for its unscored samples."""
    return np.where(scored, series, np.nan)
