"""Predicted and simulated responses of a model over the validation samples."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import zip_longest

import numpy as np

from evopem.arrays import Array, Flags
from evopem.models.polynomial import Model, simulated_form, state_space_of
from evopem.models.state_space import StateSpaceModel
from evopem.models.states import first_samples
from evopem.signals.prepared_data import PreparedData
from evopem.signals.recording import Recording


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A stretch of validation samples, with the samples before it where these are known."""

    model: StateSpaceModel  # with the level of this stretch
    plant: StateSpaceModel  # the same without poles of the noise alone
    level: Array  # (l,), as it was estimated
    recording: Recording  # the validation samples
    before: Recording | None  # what they continue
    state: Array  # of the predictor, at the first sample of all

    @property
    def first(self) -> int:
        """First validation sample, counted from the first sample that is known."""
        return self.before.samples if self.before else 0

    @property
    def inputs(self) -> Array:
        """All that is known, (N, m)."""
        known = [self.before.inputs] if self.before else []
        return np.concatenate([*known, self.recording.inputs])

    @property
    def outputs(self) -> Array:
        """All that is known, (N, l)."""
        known = [self.before.outputs] if self.before else []
        return np.concatenate([*known, self.recording.outputs])

    @property
    def unscored(self) -> int:
        """First validation samples that determine states, and are not scored."""
        if self.before:
            return 0
        samples = self.recording.samples
        return max(unscored_samples(self.model, samples), first_samples(samples))

    def predicted_from_start(self, horizon: int = 1) -> Array:
        """Predictions of all samples that are known, (N, l)."""
        return self.model.predict_with(self.outputs, self._errors, horizon)

    @cached_property
    def _errors(self) -> Array:
        return self.model.residuals(self.inputs, self.outputs, self.state)

    def predicted(self, horizon: int = 1) -> Array:
        """Predictions of the validation samples, (N, l)."""
        return self.predicted_from_start(horizon)[self.first :]

    def simulated_from_rest(self, driven: Flags | bool = True) -> Array:
        """Response to all samples of the inputs that are known, or to some inputs, (N, l)."""
        plant = replace(self.plant, B=self.plant.B * driven, D=self.plant.D * driven)
        with np.errstate(over="ignore", invalid="ignore"):
            return plant.simulate(self.inputs)

    def simulated(self, fit_level: bool) -> Array:
        """Response of the validation samples, (N, l), from a state that no scored one determines.

        It runs on from the samples before, or from the first samples where there are none.  With a
        fitted level a constant is fitted to the scored samples.
        """
        known, y = max(self.first + self.unscored, 1), self.outputs
        simulated = self._with_state(self.inputs, y, fit_level, known)
        if fit_level:
            simulated = simulated + np.mean((y - simulated)[known:], axis=0)
        return simulated[self.first :]

    def fitted(self, fit_level: bool) -> Array:
        """Response of the validation samples, (N, l), from the state that fits them best."""
        return self._with_state(self.recording.inputs, self.recording.outputs, fit_level)

    def _with_state(self, u: Array, y: Array, fit_level: bool, known: int | None = None) -> Array:
        """Response from a state that the known samples of y fit; NaN without an input."""
        if not self.model.inputs:
            return np.full(y.shape, np.nan)
        plant = replace(self.plant, level=self.level)
        return plant.simulate_from_fitted_state(u, y, fit_level, known=known)


def unscored_samples(model: StateSpaceModel, samples: int = 0) -> int:
    """Samples at the start of a record whose residuals its states and unknown inputs determine.

    And half a delay more, in which what does not outlast it decays, while half the samples remain.
    """
    delay = max(model.input_delays, default=0)
    return model.order + delay + max(min(delay // 2, samples // 2 - model.order - delay), 0)


def divided(model: Model, recording: Recording, first: int) -> tuple[HeldOut, ...]:
    """The samples of each segment from ``first`` on, with those before them."""
    long = [record for record in recording.separated if first < record.samples]
    before = [record.between(0, first) for record in long] if first else []
    return _stretches(model, [record.between(first, record.samples) for record in long], before)


def held_out_stretches(
    model: Model, prepared: PreparedData, fit_level: bool = False
) -> tuple[HeldOut, ...]:
    """The stretches of validation samples, each with the samples before it where there are some.

    The predictor runs through both parts of a continuous record, so that it knows all the measured
    past.  With a fitted level each recording without a past has one of its own.
    """
    if prepared.before_validation is None:
        return stretches_of(model, prepared.validation, fit_level)
    return _stretches(model, prepared.validation.separated, prepared.before_validation.separated)


def stretches_of(
    model: Model, recording: Recording, own_levels: bool = False
) -> tuple[HeldOut, ...]:
    """The segments of a recording without a past, with levels of their own."""
    return _stretches(model, recording.separated, (), own_levels)


def _stretches(
    model: Model,
    held_out: Sequence[Recording],
    before: Sequence[Recording | None],
    own_levels: bool = False,
) -> tuple[HeldOut, ...]:
    form, plant, responses = state_space_of(model), simulated_form(model), []
    for record, past in zip_longest(held_out, before):
        known = past or record
        if own_levels:
            with_level, state = form.with_fitted_level(known.inputs, known.outputs)
        else:
            with_level, state = form, form.prediction_state(known.inputs, known.outputs)
        of_plant = replace(plant, level=with_level.level)
        responses.append(HeldOut(with_level, of_plant, form.level, record, past, state))
    return tuple(responses)


@dataclass(frozen=True, eq=False)
class Responses:
    """Validation samples of all stretches with the computed responses, (N, l) each. ``simulated``
    runs on from what came before, ``fitted`` from the state that fits these samples; NaN without an
    input.  ``scored``, (N,): the samples that determine no state, and count."""

    outputs: Array
    predicted: Array
    simulated: Array
    fitted: Array
    scored: Flags


def responses_of(held_out: Sequence[HeldOut], fit_level: bool) -> Responses:
    """Predict and simulate the validation samples."""
    with np.errstate(all="ignore"):
        return Responses(
            outputs=np.concatenate([stretch.recording.outputs for stretch in held_out]),
            predicted=np.concatenate([stretch.predicted() for stretch in held_out]),
            simulated=np.concatenate([stretch.simulated(fit_level) for stretch in held_out]),
            fitted=np.concatenate([stretch.fitted(fit_level) for stretch in held_out]),
            scored=np.concatenate([np.arange(s.recording.samples) >= s.unscored for s in held_out]),
        )
