"""What each mode of a model adds to its simulated and predicted outputs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array, Complex
from evopem.models.modes import Mode
from evopem.models.parameter_covariance import NORMAL_95
from evopem.models.states import delayed
from evopem.validation.held_out_tests import (
    HALF_WAY,
    NO_TEST,
    SIGNIFICANCE,
    HeldOutContribution,
    HeldOutTest,
    half_waves,
    joint_contribution_test,
    left_by,
)
from evopem.validation.responses import HeldOut, Model, unscored_samples
from evopem.validation.spectra import EXCITED

# Least distance from a mode's frequency that is near it, relative; and that of four lines, in rad.
NEAR, LOBE = 0.2, 8.0 * math.pi
# Radius below which a pole is a delay, as those of more coefficients of B than of A.
DELAY_RADIUS = 1e-3
# Share of the slowest mode's amplitude behind the 2 n samples of a response that determine n poles,
# below which the response may as well be a finite one, which has no modes.
LEFT_OVER = 0.1
# The same above which a mode is no part of a finite response where no test would show it: under 300
# random sweeps that the rule was not made with, 22 of 26 true modes in doubt and none of 39 others.
HALF = 0.5
# Standard errors of a damping ratio at which a mode that inputs reach may outlast the record: on
# 353 random records none of 14 was false, of those with less than two 22 of 83.
KNOWN_DAMPING = 3.0
# Student's t of its response to the inputs from which such a mode may outlast the record, whatever
# its damping: in 450 records with tones and drifts that the rule was not made with, 10 true modes
# and 2 tones of 590 trusted modes.  Then: its least coefficient; the largest is the inverse.
CLEAR_RESPONSE, RIGHT_SIZE = 10.0, 0.75


@dataclass(frozen=True, eq=False)
class ModalParts:
    """The outputs of a record, (N, l), and what each mode adds to simulation and prediction."""

    outputs: Array
    simulated: Array
    innovations: Array
    by_input: list[Array]
    by_noise: list[Array]
    free: Array  # responses to an initial state, over the samples from ``first`` on
    first: int  # tested sample

    @classmethod
    def of(cls, modes: Sequence[Mode], record: HeldOut) -> Self:
        """Divide the outputs of a stretch whose validation samples are held out."""
        model, outputs = record.model, record.outputs
        unknown = unscored_samples(model, len(outputs))
        # Participations are those of inputs one sample before, beyond further delays.
        drives = delayed(record.inputs, [delay + 1 for delay in model.delays])
        innovations, first = outputs - record.predicted_from_start(), record.first or unknown
        innovations[:unknown] = 0.0  # errors of the state, and of inputs before the record
        past = delayed(innovations, (1,) * innovations.shape[1])
        return cls(
            outputs,
            record.simulated_from_rest(),
            innovations,
            [_response(mode, drives, mode.input_participation) for mode in modes],
            [_response(mode, past, mode.noise_participation) for mode in modes],
            free_responses(record.plant.poles(), len(outputs) - first),
            first,
        )

    def of_input(self, index: int) -> HeldOutContribution:
        """What a mode adds to the simulation, beside the other modes and real poles."""
        rest = self.simulated - sum(self.by_input, np.zeros_like(self.outputs))
        return self._beside(self.by_input, index, rest)

    def of_noise(self, index: int) -> HeldOutContribution:
        """What a mode adds to the prediction, beside the others and the simulation."""
        rest = self.outputs - self.innovations - self.simulated - sum(self.by_noise)
        return self._beside(self.by_noise, index, rest, self.simulated)

    def power_share(self, index: int) -> float:
        """Largest share of what a mode adds in the power of an output, of either drive."""
        power = np.var(self.outputs[self.first :], axis=0)
        parts = self.by_input[index], self.by_noise[index]
        of_mode = [np.var(part[self.first :], axis=0) for part in parts]
        return float(np.max(of_mode / np.where(power > 0.0, power, np.inf)))

    def excited_share(self, index: int, pole: complex) -> float:
        """Share of what a mode adds to the simulation, free responses aside, near its frequency.

        An input without power there draws the mode as a part of the response elsewhere.
        """
        part = self.by_input[index][self.first :]
        part = left_by(np.column_stack([np.ones(len(part)), self.free]), part)
        tapered = np.hanning(len(part))[:, None] * part
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

    def without(self, pole: complex, zeros: Complex) -> HeldOutContribution:
        """One-step errors of a noise filter without a pair of poles, and what these explain.

        The pair is removed together with the zeros of the filter nearest to it: a pole that these
        cancel makes no difference.  The filter of several outputs has no such zeros.
        """
        above, below = _nearest(zeros, pole), _factor(pole)
        tested = scipy.signal.lfilter(above, below, self.innovations, axis=0)[self.first :]
        explained = tested - self.innovations[self.first :]
        return HeldOutContribution(tested, explained, [np.empty((len(tested), 0))])


def _nearest(zeros: Complex, pole: complex) -> Array:
    """The factor of the pair of zeros nearest to a pole; 1 where there is no pair."""
    if len(zeros) < 2:
        return np.ones(1)
    nearest = complex(zeros[np.argmin(np.abs(zeros - pole))])
    if nearest.imag != 0.0:
        return _factor(nearest)
    by_distance = sorted(zeros[zeros.imag == 0.0].real, key=lambda zero: abs(zero - pole))
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
    return np.column_stack([powers.real, powers.imag[:, upper.imag > 0.0]])


def _response(mode: Mode, drives: Array, participation: Complex) -> Array:
    """What a pair of poles adds to the outputs, (N, l), from rest."""
    if not len(participation):
        return np.zeros((len(drives), len(mode.shape)))
    with np.errstate(over="ignore", invalid="ignore"):
        modal = scipy.signal.lfilter([1.0], [1.0, -mode.pole], drives @ participation)
        return np.asarray(2.0 * np.outer(modal, mode.shape).real)


ModeTests = tuple[HeldOutTest, HeldOutTest, float]
"""Tests of a mode's response to the inputs and of its part of predictions; its share of power."""


def held_out_mode_tests(
    modes: Sequence[Mode], held_out: Sequence[HeldOut], estimation: Sequence[HeldOut] = ()
) -> list[ModeTests]:
    """The tests of each mode on held-out samples; not possible without any.

    Where these would not show a right response to the inputs, as the last part of a sweep does not
    of slower modes, those of the estimation are tested.
    """
    with np.errstate(all="ignore"):
        # Of a stretch that is no longer than a delay nothing is left to be tested.
        records, known = (
            [part for stretch in some if len((part := ModalParts.of(modes, stretch)).free)]
            for some in (held_out, estimation)
        )
        # On all samples beside a drift as well.
        known = [replace(p, free=np.column_stack([p.free, half_waves(len(p.free))])) for p in known]
        tests = []
        for index, mode in enumerate(modes):
            of_input, of_noise = _input_test(records, index, mode.pole), NO_TEST
            if not (of_input.significant(SIGNIFICANCE) or of_input.would_show(SIGNIFICANCE)):
                fitted = 2 * (mode.shape.size + mode.input_participation.size)
                in_sample = _input_test(known, index, mode.pole).of_largest(fitted)
                of_input = of_input if math.isnan(in_sample.p_value) else in_sample
            if records and np.any(mode.noise_participation):
                of_noise = _noise_test(records, index, mode.pole, held_out[0].model.noise_zeros())
            shares = (record.power_share(index) for record in (*records, *known))
            tests.append((of_input, of_noise, max(shares, default=math.nan)))
    return tests


def pole_count(model: Model) -> int:
    """Number of poles that are no delays."""
    return int(np.sum(np.abs(model.poles()) > DELAY_RADIUS))


def has_known_damping(mode: Mode) -> bool:
    """Whether the damping ratio of a mode is far from zero in standard errors."""
    return mode.damping_ratio >= KNOWN_DAMPING * mode.damping_se


def keeps_half(model: Model, mode: Mode) -> bool:
    """Whether a mode of known damping keeps half its amplitude there, at its upper 95 % limit."""
    damping = mode.damping_ratio + NORMAL_95 * mode.damping_se
    decay = 2.0 * math.pi * mode.frequency_hz * damping / model.sampling_rate
    return has_known_damping(mode) and math.exp(-2.0 * pole_count(model) * decay) >= HALF


def is_driven_clearly(test: HeldOutTest) -> bool:
    """Whether inputs drive a mode clearly, and about as much as its model says."""
    return test.statistic >= CLEAR_RESPONSE and RIGHT_SIZE <= test.coefficient <= 1.0 / RIGHT_SIZE


def is_short(model: Model, modes: Sequence[Mode]) -> bool:
    """Whether all modes decay within so many samples that a finite response may be all there is."""
    return bool(max(abs(mode.pole) for mode in modes) ** (2 * pole_count(model)) < LEFT_OVER)


def outlasting_test(held_out: Sequence[HeldOut], estimation: Sequence[HeldOut]) -> HeldOutTest:
    """Test that the response to the inputs outlasts any finite one of as many coefficients.

    One that is finite leaves nothing beside it, whatever poles describe it, nor does any where an
    input of few frequencies cannot tell; samples as of :func:`held_out_mode_tests`.
    """
    stretches = [*held_out, *estimation]
    if not stretches or not stretches[0].model.inputs:
        return NO_TEST
    with np.errstate(all="ignore"):
        test = joint_contribution_test([_beside_finite(record) for record in held_out])
        if not (test.significant(SIGNIFICANCE) or test.would_show(SIGNIFICANCE)):
            plant, known = stretches[0].plant, [_beside_finite(record) for record in estimation]
            fitted = _lags(stretches[0]) * plant.inputs * plant.outputs
            in_sample = joint_contribution_test(known).of_largest(fitted)
            test = test if math.isnan(in_sample.p_value) else in_sample
    return test


def _beside_finite(record: HeldOut) -> HeldOutContribution:
    """The simulation, beside finite responses, those to an initial state, and waves of a drift."""
    first = record.first or unscored_samples(record.model, len(record.inputs))
    delays = [np.add(record.model.delays, lag).tolist() for lag in range(_lags(record) + 1)]
    outputs, past = record.outputs[first:], [delayed(record.inputs, k)[first:] for k in delays]
    simulated = record.simulated_from_rest()[first:]
    free = free_responses(record.plant.poles(), len(outputs))
    others = np.column_stack([*past, free, half_waves(len(free))])
    return HeldOutContribution(outputs, simulated, [others] * outputs.shape[1])


def _lags(record: HeldOut) -> int:
    """Lags of finite responses, one for each pair, with as many coefficients as the plant has."""
    plant = record.plant
    coefficients = plant.order * (plant.outputs + plant.inputs - 1) + pole_count(plant)
    return math.ceil(coefficients / (plant.outputs * plant.inputs))


def _input_test(records: Sequence[ModalParts], index: int, pole: complex) -> HeldOutTest:
    """Test of a mode's response to the inputs; none where these have no power near it."""
    if any(record.excited_share(index, pole) >= EXCITED for record in records):
        return joint_contribution_test([record.of_input(index) for record in records])
    return NO_TEST


def _noise_test(
    records: Sequence[ModalParts], index: int, pole: complex, zeros: Complex
) -> HeldOutTest:
    """Test that the noise needs a mode. Of one output its pole is removed with the zeros nearest to
    it.  Among the partial fractions of one filter neighbours make up for each other, so that
    superfluous ones would seem needed."""
    if records[0].outputs.shape[1] == 1:
        return joint_contribution_test([r.without(pole, zeros) for r in records], HALF_WAY)
    return joint_contribution_test([record.of_noise(index) for record in records])
