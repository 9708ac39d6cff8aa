"""Parts of recordings of several channels that models are scored on without having seen them.

One recording is divided into consecutive parts, and simulations of a part run on from the samples
before it.  The parts are equally long, or hold equal shares of the response to a single blow.  Of
several recordings whole ones are held out: the response to a blow lies in a few samples of its
recording, and what is left of it in the others says little.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.decision import Decision
from evopem.automatic.response_parts import REASON, response_parts
from evopem.config.settings import Objective
from evopem.estimation.state_space.held_out import (
    errors_simulated_on,
    prediction_errors,
    relative_errors,
)
from evopem.models.polynomial_states import first_samples
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording, concatenated

Array = NDArray[np.float64]

# Designs of folds, each a number of folds of consecutive samples or of recordings: few long ones
# show errors of the gain and of slow poles, many leave more samples to fit.  Large records have the
# first alone, and records of few samples the last one: half of them say too little.
DESIGNS = (2, 5)
# Values of a large and of a long record, and samples of one with few.  Values and not the cost of a
# descent: that grows with the order, and with the square of the number of recordings.
LARGE, LONG, FEW = 100_000, 40_000, 400
SHORTEST_FOLD = 24
# Least share of all samples that is left to fit where recordings are held out.
LEAST_TRAINING = 1.0 / 3.0


class Fold(Protocol):
    """What a model is fitted to, and how it is scored on the rest."""

    @property
    def training(self) -> Recording:
        """Each stretch of consecutive samples as a recording of its own."""

    def errors(self, model: StateSpaceModel, objective: Objective) -> Array:
        """Errors in percent of a model of the training part, (3, ny), by their kind of mean.

        Of simulations of the held-out samples with the model's level and with a free one, NaN
        without an input, and of predictions.
        """


@dataclass(frozen=True, eq=False)
class PartOfRecording:
    """Consecutive samples of one recording, not its first ones, are held out."""

    recording: Recording
    first: int
    stop: int

    @property
    def training(self) -> Recording:
        """What stands before and behind them, where it is long enough."""
        recording = self.recording
        ends = recording.between(0, self.first), recording.between(self.stop, recording.samples)
        return concatenated([each for each in ends if each.samples >= SHORTEST_FOLD])

    def errors(self, model: StateSpaceModel, objective: Objective) -> Array:
        """Errors in percent, (3, ny)."""
        recording = self.recording
        held = recording.between(self.first, self.stop)
        with np.errstate(all="ignore"):
            predicted = prediction_errors(model, held.inputs, held.outputs, objective)
        if not recording.has_input:
            return _of_prediction(predicted)
        u, y = recording.inputs[: self.stop], recording.outputs[: self.stop]
        simulated = [
            relative_errors(
                errors_simulated_on(model, u, y, self.first, free_level, objective),
                held.outputs,
                objective,
            )
            for free_level in (False, True)
        ]
        return np.array([*simulated, predicted])


@dataclass(frozen=True, eq=False)
class WholeRecordings:
    """Whole recordings are held out."""

    training: Recording
    held_out: Recording

    def errors(self, model: StateSpaceModel, objective: Objective) -> Array:
        """Errors in percent, (3, ny): root mean square, or mean, over the recordings."""
        power = 1.0 if objective == "absolute" else 2.0
        centre = np.median if objective == "absolute" else np.mean
        total, spreads = np.zeros((3, model.outputs)), np.zeros(model.outputs)
        for each in self.held_out.separated:
            around = centre(each.outputs, axis=0)
            spread = np.sum(np.abs(each.outputs - around) ** power, axis=0)
            total += _errors_alone(model, each, objective) ** power * spread
            spreads += spread
        with np.errstate(all="ignore"):
            return np.asarray((total / spreads) ** (1.0 / power))


def folds_of(estimation: Recording, count: int) -> list[Fold]:
    """The folds of a design.

    Parameters
    ----------
    estimation : Recording
    count : int
        Number of parts of one recording, or of groups of several.
    """
    if estimation.is_joined:
        return list(_folds_of_recordings(estimation.separated, count))
    edges = _response_edges(estimation, count)
    if edges is None:
        edges = np.linspace(0, estimation.samples, count + 1).round().astype(int).tolist()
    # Simulations run on from samples before: the first part is never held out.
    return [PartOfRecording(estimation, *edge) for edge in list(pairwise(edges))[1:]]


def describe_folds(estimation: Recording) -> Decision:
    """Which parts of an estimation part models are scored on, and why.

    Parameters
    ----------
    estimation : Recording
    """
    designs = designs_of(estimation)
    if estimation.is_joined:
        reason = "Whole recordings are held out, one group after the other."
    elif any(_response_edges(estimation, count) for count in designs):
        reason = REASON
    else:
        reason = "Parts of equal length are held out, one after the other but the first."
    chosen = " and ".join(f"{count} parts" for count in designs)
    return Decision("folds", chosen, (), "none", reason)


def _response_edges(estimation: Recording, count: int) -> list[int] | None:
    """Ends of the parts of the response to a single blow; None for other records."""
    return response_parts(estimation.inputs, estimation.outputs, count, SHORTEST_FOLD)


def _folds_of_recordings(records: Sequence[Recording], count: int) -> Iterator[WholeRecordings]:
    """Recordings dealt out to the folds in turn; enough samples are left to fit."""
    samples = sum(each.samples for each in records)
    for fold in range(min(count, len(records))):
        held = records[fold::count]
        training = [each for place, each in enumerate(records) if place % count != fold]
        if sum(each.samples for each in training) >= LEAST_TRAINING * samples:
            yield WholeRecordings(concatenated(training), concatenated(held))


def designs_of(estimation: Recording) -> tuple[int, ...]:
    """The designs of folds that models of an estimation part are scored by."""
    if estimation.is_joined:
        recordings = len(estimation.segment_starts)
        designs = tuple(dict.fromkeys(min(count, recordings) for count in DESIGNS))
        return designs[:1] if is_large(estimation) else designs
    if is_large(estimation) or estimation.samples < DESIGNS[-1] * SHORTEST_FOLD:
        return DESIGNS[:1]
    return DESIGNS[-1:] if estimation.samples < FEW else DESIGNS


def fewest_fitted(estimation: Recording) -> int:
    """Samples that the smallest training part of all folds has."""
    if estimation.is_joined:
        designs = [folds_of(estimation, count) for count in designs_of(estimation)]
        return min(each.training.samples for folds in designs for each in folds)
    fewest_folds = min(designs_of(estimation))
    return estimation.samples - -(-estimation.samples // fewest_folds)


def is_large(estimation: Recording) -> bool:
    """Whether a record has so many values that searches over orders are shortened."""
    return _values(estimation) > LARGE


def is_long(estimation: Recording) -> bool:
    """Whether a record has so many values that orders of noise models are tried in steps of two."""
    return _values(estimation) > LONG


def _values(estimation: Recording) -> int:
    return estimation.inputs.size + estimation.outputs.size


def _errors_alone(model: StateSpaceModel, record: Recording, objective: Objective) -> Array:
    """Errors in percent of a record by itself, (3, ny).

    Squares are divided by the values less the levels, or the states of a predictor, that were
    fitted to them.
    """
    u, y = record.inputs, record.outputs
    with np.errstate(all="ignore"):
        if record.has_input:
            known = first_samples(len(y))
            share = len(y) / (len(y) - known)
            # As if the samples that determine the state had errors as large as the others.
            scale = share if objective == "absolute" else np.sqrt(share)
            constant, free = (
                scale
                * relative_errors(
                    errors_simulated_on(model, u, y, known, free_level, objective), y, objective
                )
                for free_level in (False, True)
            )
            if not model.K.any():
                # Without a noise model the prediction is the simulation.
                return np.array([constant, free * _inflation(y, model.outputs), constant])
        predicted = prediction_errors(model, u, y, objective) * _inflation(y, model.order)
    if not record.has_input:
        return _of_prediction(predicted)
    return np.array([constant, free * _inflation(y, model.outputs), predicted])


def _inflation(outputs: Array, fitted: int) -> float:
    return float(np.sqrt(outputs.size / max(outputs.size - fitted, 1)))


def _of_prediction(predicted: Array) -> Array:
    unknown = np.full(len(predicted), np.nan)
    return np.array([unknown, unknown, predicted])
