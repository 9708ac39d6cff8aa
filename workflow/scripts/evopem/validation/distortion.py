"""What no linear model can explain of the response to a periodic input.

The error of the simulation is divided into what changes from period to period (noise), what repeats
with the period without being a linear response (nonlinear distortion), and the rest, which is the
model's.  Distortion shows where the output has power at lines that the input leaves out (the fast
method), or where it differs from one realisation of the input to another (the robust method;
Pintelon & Schoukens 2012, sections 4.3.1 and 4.3.2).

Below the floor of the simulation error no linear model goes.  Under a periodic input it is what is
no linear response; else what past inputs explain of the error by no finite impulse response, whose
fit has a known error.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from evopem.arrays import Array, Complex
from evopem.signals.best_linear_approximation import (
    excited_lines,
    realisations_of,
    same_realisation,
    spectra_of_periods,
)
from evopem.signals.least_squares import autoregression
from evopem.validation.error_parts import (
    FEWEST_LINES,
    ErrorParts,
    Levels,
    Lines,
    Part,
    bounds_of,
    parts_of,
)
from evopem.validation.held_out_tests import MOST_WHITENING, filtered, left_by
from evopem.validation.responses import HeldOut

# A first period differs by a transient where its variance is so many times that of later ones.
TRANSIENT = 2.0
SIGNIFICANCE = 0.01  # distortion counts as shown at this level of significance


@dataclass(frozen=True)
class Distortion:
    """Nonlinear distortion in the response to a periodic input, or why it is not judged."""

    reason: str = ""  # why it is not judged; empty where it is
    on: Literal["validation", "estimation"] = "validation"  # the samples
    period: int = 0  # samples
    periods: int = 0  # of each realisation, without transients
    realisations: int = 0
    p_value: float = math.nan  # of the hypothesis that there is no distortion
    # whether distortion is known at the lines of the input, too; else it is the least there can be
    separated: bool = False
    outputs: tuple[ErrorParts, ...] = ()
    levels: tuple[Levels, ...] = ()  # of a record with one input

    @property
    def shown(self) -> bool:
        """Whether distortion is significant."""
        most = max((output.distortion.low for output in self.outputs), default=0.0)
        return self.p_value < SIGNIFICANCE and most > 0.0

    @property
    def prevails(self) -> bool:
        """Whether it is significant, and more of the error of each output than the rest is."""
        return self.shown and all(
            output.distortion.percent >= output.rest.percent for output in self.outputs
        )


NOT_TESTED = Distortion("It was not tested.")


def distortion_of(
    validation: Sequence[HeldOut], estimation: Sequence[HeldOut], fit_level: bool
) -> Distortion:
    """Divide the error of the simulation on validation samples, else on estimation samples.

    On these, too, where they alone tell distortion at the lines of the input from the response.
    """
    first = _judged(validation, fit_level, "validation")
    if first.separated:
        return first
    second = _judged(estimation, fit_level, "estimation")
    return second if second.separated or (first.reason and not second.reason) else first


@dataclass(frozen=True, eq=False)
class _Realisation:
    """Spectra of its last periods, (P, F, channels), and powers of each output."""

    inputs: Complex
    outputs: Complex  # without drift
    response: Complex  # of the model in steady state
    variance: Array  # (l,) of the outputs
    drift: Array  # (l,) variance of what is slower than a period
    error: Array  # (l,) mean square of the simulation error

    @classmethod
    def of(cls, stretch: HeldOut, period: int, fit_level: bool, at: slice) -> Self | None:
        """The periods after transients; None where there are not two, or nothing to compare."""
        first = max(at.start, stretch.unscored)
        if at.stop - first < 2 * period:  # all samples may be enough
            first = at.start
        y, simulated = stretch.recording.outputs[: at.stop], stretch.simulated(fit_level)[: at.stop]
        y, simulated = y[first:], simulated[first:]
        count = len(y) // period
        if count < 2 or not np.isfinite(simulated).all() or not np.ptp(y, axis=0).all():
            return None
        parts = y[len(y) - count * period :].reshape(count, period, -1)
        kept = (count - _transient_periods(parts)) * period
        drift = _drift(y[-kept:], period)
        inputs = spectra_of_periods(stretch.recording.inputs[: at.stop][-kept:], period)
        lines = np.arange(1, inputs.shape[1]) / period * stretch.recording.sampling_rate
        gain = stretch.plant.frequency_response(lines)
        response = np.zeros((*inputs.shape[:2], y.shape[1]), dtype=complex)
        response[:, 1:] = np.einsum("flm,pfm->pfl", gain, inputs[:, 1:])
        if not np.isfinite(response).all():
            return None
        return cls(
            *(inputs, spectra_of_periods(y[-kept:] - drift, period), response),
            *(np.var(y[-kept:], axis=0), np.var(drift, axis=0)),
            np.mean((y - simulated)[-kept:] ** 2, axis=0),
        )


def _transient_periods(outputs: Array) -> int:
    """How many of the first periods, (P, T, l), differ from later ones; two are left."""
    first = 0
    while len(outputs) - first > 2:
        later = outputs[first + 1 :]
        change = np.mean((outputs[first] - later.mean(axis=0)) ** 2, axis=0)
        noise = np.var(later, axis=0, ddof=1).mean(axis=0) * (1.0 + 1.0 / len(later))
        if (change <= TRANSIENT * noise).all():
            break
        first += 1
    return first


def _drift(outputs: Array, period: int) -> Array:
    """Straight lines through the means of the periods, (N, l). A drift would leave a part in every
    period that looks the same, or is alike at all lines."""
    means = outputs.reshape(-1, period, outputs.shape[1]).mean(axis=1)
    ends = 2.0 * means[[0, -1]] - means[[1, -2]]
    places = period * (np.arange(-1, len(means) + 1) + 0.5) - 0.5
    known = np.vstack([ends[:1], means, ends[1:]])
    time = np.arange(len(outputs))
    return np.column_stack([np.interp(time, places, y) for y in known.T])


def _judged(
    stretches: Sequence[HeldOut], fit_level: bool, on: Literal["validation", "estimation"]
) -> Distortion:
    """The division of the error on some samples, or why there is none."""
    if not stretches or not stretches[0].model.inputs:
        return Distortion("There is no input.", on)
    repetitions = [realisations_of(stretch.recording.inputs) for stretch in stretches]
    longest = int(np.argmax([stretch.recording.samples for stretch in stretches]))
    period = repetitions[longest][0]
    if not period:
        return Distortion("The input does not repeat over two periods or more.", on)
    whole = [
        _Realisation.of(stretch, period, fit_level, at)
        for stretch, (repeats_after, places) in zip(stretches, repetitions, strict=True)
        for at in places
        if repeats_after == period
    ]
    kept = _of_one_kind([part for part in whole if part is not None], period)
    if not kept:
        return Distortion("There are no two whole periods to be simulated.", on)
    periods = min(len(part.inputs) for part in kept)
    u: Complex = np.stack([part.inputs[-periods:] for part in kept])
    y: Complex = np.stack([part.outputs[-periods:] for part in kept])
    response: Complex = np.stack([part.response[-periods:] for part in kept])
    lines = Lines.of(u, period)
    if not lines.by_realisations and np.sum(lines.left_out) < FEWEST_LINES:
        return Distortion("Realisations with other phases, or fewer lines, would show it.", on)
    split, levels = [], []
    separated = lines.by_realisations or lines.levels is not None
    power = np.sum(np.abs(u.mean(axis=1)) ** 2, axis=0)[lines.excited, 0]
    at = np.flatnonzero(lines.excited) / period * stretches[0].recording.sampling_rate
    for k, name in enumerate(stretches[0].recording.output_names):
        scale, error, drift = (
            float(np.mean([getattr(part, kind)[k] for part in kept]))
            for kind in ("variance", "error", "drift")
        )
        spectra = y[..., k] / math.sqrt(scale), response[..., k] / math.sqrt(scale)
        split.append(parts_of(name, (error / scale, drift / scale), u, *spectra, lines))
        if u.shape[3] == 1:
            levels.append(Levels.of(name, at, *(scale * split[-1][2] / power)))
    p_value = min(len(split) * min(p for _, p, _ in split), 1.0)
    numbers = period, periods, len(kept), p_value, separated
    return Distortion("", on, *numbers, tuple(parts for parts, *_ in split), tuple(levels))


def _of_one_kind(whole: Sequence[_Realisation], period: int) -> list[_Realisation]:
    """The realisations with the same lines as the first one, each of them once."""
    kept: list[_Realisation] = []
    for part in whole:
        spectrum = part.inputs.mean(axis=0)
        lines = excited_lines(spectrum[None])
        if not lines.any():
            continue  # an input that rests repeats as well
        others = [known.inputs.mean(axis=0) for known in kept]
        of_first = excited_lines(others[0][None]) if others else lines
        if np.array_equal(of_first, lines) and not any(
            same_realisation(spectrum, x, period) for x in others
        ):
            kept.append(part)
    return kept


# Lags of all inputs at most, samples for each of them, and fewest of an input; samples at most.
MOST_LAGS, SAMPLES_PER_LAG, FEWEST_LAGS, MOST_SAMPLES = 300, 20, 5, 20_000
BEYOND = 0.01  # share of the energy of the plant's responses that later lags may have
REACHED = 0.9  # share of the error from which on a floor is reached


@dataclass(frozen=True)
class Floor:
    """The floor of the simulation error of an output, percent of its standard deviation."""

    name: str
    error_percent: float
    floor: Part
    rest: Part  # the model's part: the squares of both add up to that of the error

    @classmethod
    def of(cls, name: str, error: float, rest: Part) -> Self:
        """Of an error and the model's part of it."""
        left = (error**2 - part**2 for part in (rest.percent, rest.high, rest.low))
        return cls(name, error, Part(*(math.sqrt(max(x, 0.0)) for x in left)), rest)

    @property
    def reached(self) -> bool:
        """Whether the error is at the floor, with 95 % confidence."""
        return self.error_percent > 0.0 and self.floor.low >= REACHED * self.error_percent


def floors_of(
    distortion: Distortion, held_out: Sequence[HeldOut], fit_level: bool
) -> tuple[Floor, ...]:
    """The floor of each output; none where the data do not say it, as without an input.

    Feedback, which makes later inputs depend on the noise, is left to its check.
    """
    if not distortion.reason:
        known = distortion.outputs if distortion.separated else ()
        return tuple(Floor.of(x.name, x.error_percent, x.rest) for x in known)
    inputs = held_out[0].model.inputs
    samples = sum(stretch.recording.samples - stretch.unscored for stretch in held_out)
    lags = min(MOST_LAGS, samples // SAMPLES_PER_LAG) // max(inputs, 1)
    if not inputs or lags < FEWEST_LAGS or _is_longer(held_out[0], lags):
        return ()
    outputs, errors, rows = [], [], []
    for stretch in held_out:
        y, u, first = stretch.recording.outputs, stretch.inputs, stretch.unscored
        last = first + MOST_SAMPLES // len(held_out)
        padded = np.vstack([np.zeros((lags - 1, inputs)), u - u.mean(axis=0)])
        windows = np.lib.stride_tricks.sliding_window_view(padded, lags, axis=0)
        rows.append(windows[stretch.first :][first:last].reshape(-1, lags * inputs))
        errors.append((y - stretch.simulated(fit_level))[first:last])
        outputs.append(y[first:last])
    scales = np.std(np.concatenate(outputs), axis=0)
    if not all(np.isfinite(e).all() for e in errors) or not scales.all():
        return ()
    names = held_out[0].recording.output_names
    return tuple(
        _floor(name, [e[:, k] / scales[k] for e in errors], rows) for k, name in enumerate(names)
    )


def _is_longer(stretch: HeldOut, lags: int) -> bool:
    """Whether the plant remembers more than so many samples."""
    energies = np.sum(stretch.plant.impulse_response(10 * lags) ** 2, axis=(1, 2))
    return not float(np.sum(energies[lags:])) <= BEYOND * float(np.sum(energies))


def _floor(name: str, errors: Sequence[Array], rows: Sequence[Array]) -> Floor:
    """The part of an error that inputs at some lags explain, beside a constant, and the floor."""
    error, columns = np.concatenate(errors), np.insert(np.concatenate(rows), 0, 1.0, axis=1)
    whitening = autoregression(left_by(columns, error), MOST_WHITENING)
    white = [
        filtered(np.column_stack([np.ones(len(e)), u, e]), whitening)
        for e, u in zip(errors, rows, strict=True)
    ]
    basis, e = np.split(np.vstack(white), [-1], axis=1)
    inverse = np.linalg.pinv(basis.T @ basis, hermitian=True) @ basis.T
    fitted = inverse @ e[:, 0]
    # Errors whose size depends on the inputs, as distortion does (MacKinnon & White 1985, HC2).
    leverage = np.einsum("ij,ji->i", basis, inverse)
    weighted = inverse * (e[:, 0] - basis @ fitted) / np.sqrt(np.maximum(1.0 - leverage, 1e-6))
    power = columns.T @ columns / len(columns)
    product = power @ weighted @ weighted.T
    explained = float(fitted @ power @ fitted) - float(np.trace(product))
    variance = 2.0 * float(np.sum(product * product.T))
    variance += 4.0 * float(fitted @ product @ power @ fitted)
    rest = Part.of(explained, bounds_of(explained, variance))
    return Floor.of(name, 100.0 * math.sqrt(float(np.mean(error**2))), rest)
