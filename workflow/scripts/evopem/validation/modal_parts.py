"""What each mode of a model adds to its simulated and predicted outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evopem.models.modes import Mode
from evopem.models.state_space import StateSpaceModel
from evopem.validation.held_out_tests import HeldOutContribution

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class ModalParts:
    """The outputs of a record, (N, ny), and what each mode adds to simulation and prediction.

    ``free``: responses to an initial state, over the samples from ``first`` on.
    """

    outputs: Array
    simulated: Array
    by_input: list[Array]
    by_noise: list[Array]
    rest_of_input: Array
    rest_of_noise: Array
    free: Array
    first: int

    @classmethod
    def of(
        cls,
        model: StateSpaceModel,
        modes: Sequence[Mode],
        inputs: Array,
        outputs: Array,
        first: int,
    ) -> ModalParts:
        """Divide a record's outputs; ``first``: the first sample of the held-out part."""
        innovations = model.residuals(inputs, outputs, model.prediction_state(inputs, outputs))
        simulated = model.simulate(inputs)
        delayed = _delayed(model, inputs)
        by_input = [_response(mode, delayed, mode.input_participation) for mode in modes]
        by_noise = [_response(mode, innovations, mode.noise_participation) for mode in modes]
        nothing = np.zeros_like(outputs)
        return cls(
            outputs,
            simulated,
            by_input,
            by_noise,
            simulated - sum(by_input, nothing),
            outputs - innovations - simulated - sum(by_noise, nothing),
            _free_responses(model.poles(), len(outputs) - first),
            first,
        )

    def of_input(self, index: int) -> HeldOutContribution:
        """What a mode adds to the simulation, beside the other modes and real poles."""
        return self._beside(self.by_input, index, self.rest_of_input)

    def of_noise(self, index: int) -> HeldOutContribution:
        """What a mode adds to the prediction, beside the others and the simulation."""
        return self._beside(self.by_noise, index, self.rest_of_noise, self.simulated)

    def _beside(self, parts: list[Array], index: int, *more: Array) -> HeldOutContribution:
        first, others = self.first, [*parts[:index], *parts[index + 1 :], *more]
        nuisance = [
            np.column_stack([*(other[first:, column] for other in others), self.free])
            for column in range(self.outputs.shape[1])
        ]
        return HeldOutContribution(self.outputs[first:], parts[index][first:], nuisance)


def _response(mode: Mode, drives: Array, participation: Complex) -> Array:
    """What a pair of poles adds to the outputs, (N, ny), driven one sample before; from rest."""
    from scipy.signal import lfilter

    modal = lfilter([0.0, 1.0], [1.0, -mode.pole], drives @ participation)
    response: Array = 2.0 * np.outer(modal, mode.shape).real
    return response


def _delayed(model: StateSpaceModel, inputs: Array) -> Array:
    delayed = np.zeros_like(inputs)
    for column, delay in enumerate(model.input_delays or (0,) * model.inputs):
        delayed[delay:, column] = inputs[: len(inputs) - delay, column]
    return delayed


def _free_responses(poles: Complex, samples: int) -> Array:
    """Responses to an initial state, two for each pair of poles and one for each real one."""
    upper = poles[poles.imag >= 0.0]
    powers = upper ** np.arange(samples)[:, None]
    free: Array = np.column_stack([powers.real, powers.imag[:, upper.imag > 0.0]])
    return free
