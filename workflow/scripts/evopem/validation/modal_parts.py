"""What each mode of a model adds to its simulated and predicted outputs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from evopem.arrays import Array, Complex
from evopem.models.modes import Mode
from evopem.models.states import delayed
from evopem.validation.held_out_tests import (
    NO_TEST,
    HeldOutContribution,
    HeldOutTest,
    improvement_test,
    joint_contribution_test,
)
from evopem.validation.responses import HeldOut
from evopem.validation.spectra import EXCITED

# Least distance from a mode's frequency that is near it, relative; and that of four lines, in rad.
NEAR, LOBE = 0.2, 8.0 * math.pi


@dataclass(frozen=True, eq=False)
class ModalParts:
    """The outputs of a record, (N, l), and what each mode adds to simulation and prediction."""

    outputs: Array
    simulated: Array
    innovations: Array
    by_input: list[Array]
    by_noise: list[Array]
    free: Array  # responses to an initial state, over the samples from ``first`` on
    first: int

    @classmethod
    def of(cls, modes: Sequence[Mode], record: HeldOut) -> Self:
        """Divide the outputs of a stretch whose validation samples are held out."""
        model, outputs = record.model, record.outputs
        # Participations are those of inputs one sample before, beyond further delays.
        drives = delayed(record.inputs, [delay + 1 for delay in model.delays])
        innovations = outputs - record.predicted_from_start()
        past = delayed(innovations, (1,) * innovations.shape[1])
        return cls(
            outputs,
            record.simulated_from_rest(),
            innovations,
            [_response(mode, drives, mode.input_participation) for mode in modes],
            [_response(mode, past, mode.noise_participation) for mode in modes],
            free_responses(record.plant.poles(), len(outputs) - record.first),
            record.first,
        )

    def of_input(self, index: int) -> HeldOutContribution:
        """What a mode adds to the simulation, beside the other modes and real poles."""
        rest = self.simulated - sum(self.by_input, np.zeros_like(self.outputs))
        return self._beside(self.by_input, index, rest)

    def of_noise(self, index: int) -> HeldOutContribution:
        """What a mode adds to the prediction, beside the others and the simulation."""
        rest = self.outputs - self.innovations - self.simulated
        rest = rest - sum(self.by_noise, np.zeros_like(self.outputs))
        return self._beside(self.by_noise, index, rest, self.simulated)

    def power_share(self, index: int) -> float:
        """Largest share of what a mode adds in the power of an output, of either drive."""
        power = np.var(self.outputs[self.first :], axis=0)
        of_mode = [
            np.var(part[index][self.first :], axis=0) for part in (self.by_input, self.by_noise)
        ]
        return float(np.max(of_mode / np.where(power > 0.0, power, np.inf)))

    def excited_share(self, index: int, pole: complex) -> float:
        """Share of what a mode adds to the simulation that lies near its frequency.

        An input without power there draws the mode as a part of the response elsewhere.
        """
        part = self.by_input[index][self.first :]
        tapered = np.hanning(len(part))[:, None] * (part - part.mean(axis=0))
        power = np.sum(np.abs(np.fft.rfft(tapered, axis=0)) ** 2, axis=1)
        distance = np.abs(np.linspace(0.0, np.pi, len(power)) - np.angle(pole))
        width = max(-2.0 * np.log(abs(pole)), NEAR * np.angle(pole), LOBE / len(part))
        return float(power[distance <= width].sum() / power.sum())

    def _beside(self, parts: list[Array], index: int, *more: Array) -> HeldOutContribution:
        # The other modes are regressors, not taken as right: of two close poles that cancel each
        # other's response, neither may pass because the other one is there.
        first, others = self.first, [*parts[:index], *parts[index + 1 :], *more]
        nuisance = [
            np.column_stack([*(part[first:, column] for part in others), self.free])
            for column in range(self.outputs.shape[1])
        ]
        return HeldOutContribution(self.outputs[first:], parts[index][first:], nuisance)

    def without(self, pole: complex, zeros: Complex) -> tuple[Array, Array]:
        """One-step errors of a noise filter without a pair of poles, and those with it, (N, 1).

        The pair is removed together with the zeros of the filter nearest to it: a pole that these
        cancel makes no difference.  The filter of several outputs has no such zeros.
        """
        from scipy.signal import lfilter

        without = lfilter(_nearest(zeros, pole), _factor(pole), self.innovations, axis=0)
        return without[self.first :], self.innovations[self.first :]


def _nearest(zeros: Complex, pole: complex) -> Array:
    """The factor of the pair of zeros nearest to a pole; 1 where there is no pair."""
    if len(zeros) < 2:
        return np.ones(1)
    nearest = complex(zeros[np.argmin(np.abs(zeros - pole))])
    if nearest.imag != 0.0:
        return _factor(nearest)
    real = np.sort(zeros[zeros.imag == 0.0].real)
    by_distance = real[np.argsort(np.abs(real - pole), kind="stable")]
    # A real zero without a partner is the last one left beside complex pairs.
    return np.real(np.poly(by_distance[:2]))


def _factor(root: complex) -> Array:
    """``(1 - p w)(1 - p* w)``."""
    return np.array([1.0, -2.0 * root.real, abs(root) ** 2])


def free_responses(poles: Complex, samples: int) -> Array:
    """Responses to an initial state, two for each pair of poles and one for each real one."""
    upper = poles[poles.imag >= 0.0]
    with np.errstate(over="ignore", invalid="ignore"):
        powers = upper ** np.arange(samples)[:, None]
    free: Array = np.column_stack([powers.real, powers.imag[:, upper.imag > 0.0]])
    return free


def _response(mode: Mode, drives: Array, participation: Complex) -> Array:
    """What a pair of poles adds to the outputs, (N, l), from rest."""
    from scipy.signal import lfilter

    if not len(participation):
        return np.zeros((len(drives), len(mode.shape)))
    with np.errstate(over="ignore", invalid="ignore"):
        modal = lfilter([1.0], [1.0, -mode.pole], drives @ participation)
        response: Array = 2.0 * np.outer(modal, mode.shape).real
    return response


ModeTests = tuple[HeldOutTest, HeldOutTest, float]
"""Tests of a mode's response to the inputs and of its part of predictions; its share of power."""


def held_out_mode_tests(modes: Sequence[Mode], held_out: Sequence[HeldOut]) -> list[ModeTests]:
    """The tests of each mode on held-out samples; not possible without any."""
    with np.errstate(all="ignore"):
        records = [ModalParts.of(modes, stretch) for stretch in held_out]
        tests = []
        for index, mode in enumerate(modes):
            of_input, of_noise = NO_TEST, NO_TEST
            if any(record.excited_share(index, mode.pole) >= EXCITED for record in records):
                of_input = joint_contribution_test([record.of_input(index) for record in records])
            if records and np.any(mode.noise_participation):
                of_noise = _noise_test(records, index, mode.pole, held_out[0].model.noise_zeros())
            share = max((record.power_share(index) for record in records), default=math.nan)
            tests.append((of_input, of_noise, share))
    return tests


def _noise_test(
    records: Sequence[ModalParts], index: int, pole: complex, zeros: Complex
) -> HeldOutTest:
    """Test that the noise needs a mode.

    Of one output its pole is removed with the zeros nearest to it.  Among the partial fractions of
    one filter neighbours make up for each other, so that superfluous ones would seem needed.
    """
    if records[0].outputs.shape[1] == 1:
        return improvement_test([record.without(pole, zeros) for record in records])
    return joint_contribution_test([record.of_noise(index) for record in records])
