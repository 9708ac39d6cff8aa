"""The parts of the simulation error of one output: noise, nonlinear distortion, and the rest.

From spectra of the periods of M realisations, at lines that the input excites or leaves out
(Pintelon & Schoukens 2012, "System Identification", sections 4.3.1 and 4.3.2).
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import csr_array
from scipy.special import chdtrc, chdtri, fdtrc

from evopem.arrays import Array, Complex, Flags
from evopem.models.parameter_covariance import NORMAL_95
from evopem.signals.best_linear_approximation import (
    best_linear_approximation,
    excited_lines,
    interpolated_lines,
)
from evopem.signals.spectra import line_weights

# Lines left out, of the parity of the excited ones, that give the level of distortion there.
FEWEST_LINES = 6
# Share of equal distances from which on excited lines are a regular grid: distortion then falls on
# excited lines and hardly on those between.
REGULAR = 0.9
MOST_LEVELS = 100  # lines at which levels are stated
ROUNDING = 1e-20  # rounding, as a share of the variance of the output
# Degrees of freedom of an estimated power from which on its interval is that of chi-square.
FEWEST_FREEDOM = 10.0


@dataclass(frozen=True)
class Part:
    """A part of an error in percent of the output's standard deviation, with a 95 % interval."""

    percent: float
    low: float
    high: float

    @classmethod
    def of(cls, power: float, bounds: tuple[float, float]) -> Self:
        """Of a power as a share of the output's."""
        return cls(*(100.0 * math.sqrt(max(x, 0.0)) for x in (power, *bounds)))


def bounds_of(power: float, variance: float) -> tuple[float, float]:
    """A 95 % interval of an estimated power: chi-square where it is well above 0."""
    freedom = 2.0 * power**2 / variance if variance > 0.0 else 0.0
    if power > 0.0 and freedom >= FEWEST_FREEDOM:
        low, high = (power * freedom / chdtri(freedom, tail) for tail in (0.025, 0.975))
        return low, high
    deviation = NORMAL_95 * math.sqrt(variance)
    return power - deviation, power + deviation


@dataclass(frozen=True)
class ErrorParts:
    """Parts of the simulation error of an output; their squares add up to its square."""

    name: str
    error_percent: float  # of the whole periods
    noise: Part
    distortion: Part
    rest: Part  # the model's error, and distortion where this is not separated
    # Part of the distortion at even lines, which squares make and cubes do not, 0 to 1; NaN where
    # the input has even lines, too
    even_share: float = math.nan


@dataclass(frozen=True)
class Levels:
    """What moves the gain that the data give: standard deviations, output unit / input unit.

    At lines of the input, of which many are averaged in groups; of records with one input.
    """

    output: str
    frequency_hz: tuple[float, ...]
    noise: tuple[float, ...]
    distortion: tuple[float, ...]  # without noise

    @classmethod
    def of(cls, output: str, frequencies: Array, noise: Array, distortion: Array) -> Self:
        """Of variances at E lines."""
        groups = np.array_split(np.arange(len(frequencies)), min(len(frequencies), MOST_LEVELS))
        means = np.array(
            [[np.mean(x[group]) for group in groups] for x in (frequencies, noise, distortion)]
        )
        return cls(output, *map(tuple, [means[0].tolist(), *np.sqrt(means[1:]).tolist()]))


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of M realisations, and what they tell."""

    weights: Array  # (F,) of squared coefficients in a power
    excited: Flags  # (F,)
    left_out: Flags
    by_realisations: bool  # whether there are more of them than inputs
    # weights that take powers at lines left out to excited ones, (F, F); None where these are
    # of another kind
    levels: csr_array | None

    @classmethod
    def of(cls, inputs: Complex, period: int) -> Self:
        """Of spectra (M, P, F, m)."""
        excited = excited_lines(inputs.mean(axis=1))
        left_out = ~excited
        left_out[0] = False
        return cls(
            *(line_weights(period), excited, left_out, len(inputs) > inputs.shape[3]),
            _levels(excited, left_out),
        )


def _levels(excited: Flags, left_out: Flags) -> csr_array | None:
    """Interpolation from lines left out to excited lines of the same parity. None where excited
    lines of a parity are a regular grid or have too few lines between them."""
    count = len(excited)
    weights, at = csr_array((count, count)), np.flatnonzero(excited)
    inside = np.zeros(count, dtype=bool)
    inside[at[0] : at[-1]] = True
    for parity in (0, 1):
        alike = np.arange(count) % 2 == parity
        lines, between = excited & alike, left_out & alike & inside
        if not lines.any():
            continue
        distances = np.diff(np.flatnonzero(lines))
        most = np.bincount(distances).max() if len(distances) else 1
        if between.sum() < FEWEST_LINES or most >= REGULAR * max(len(distances), 1):
            return None
        weights = weights + interpolated_lines(between, lines)
    return weights


def parts_of(
    name: str, powers: tuple[float, float], u: Complex, y: Complex, simulated: Complex, lines: Lines
) -> tuple[ErrorParts, float, Array]:
    """The parts of a simulation error, the p-value of no distortion, and levels.

    Levels are variances of noise and distortion in the mean output at excited lines, (2, E).

    Inputs (M, P, F, m), measured and simulated output (M, P, F) over the standard deviation of the
    output; ``powers`` are those of the whole error and of the drift in it.
    """
    total, drift = powers
    count, periods = y.shape[:2]
    freedom = 2 * count * (periods - 1)
    e = y - simulated
    of_period = np.var(e, axis=1, ddof=1).mean(axis=0)
    noise, w = of_period / periods, lines.weights
    power, driven = (np.mean(np.abs(x.mean(axis=1)) ** 2, axis=0) for x in (e, simulated))
    on, off = lines.excited, lines.left_out
    response, variances = best_linear_approximation(u[:, :, on], e[:, :, on, None])
    allowed = _allowed(u.mean(axis=1), power, driven, response[:, 0], lines)
    level = power - noise
    level = np.where(off, level - np.minimum(allowed, np.maximum(level, 0.0)), 0.0)
    spread = np.where(off, (2.0 * np.maximum(level, 0.0) + noise) * noise, 0.0)
    spread *= periods / (periods - 1) / count
    p_values = fdtrc(2 * count, freedom, power[off] / (noise + allowed)[off])
    if lines.by_realisations:
        at_lines, more = variances[:, 0], count - u.shape[3]
        noise_on = noise[on] + ROUNDING
        p_values = np.append(p_values, fdtrc(2 * more, freedom, at_lines / noise_on))
        distortion = float(w @ level + w[on] @ (at_lines - noise_on))
        variance = float(w**2 @ spread + w[on] ** 2 @ (at_lines**2 / more + noise_on**2 / freedom))
    else:
        weights = csr_array((len(w), len(w))) if lines.levels is None else lines.levels
        at_lines, taken = np.maximum(weights @ level, 0.0)[on], w @ weights
        distortion = float((w + taken) @ level)
        # What is at a line varies about its level as much as what is there at another one.
        squares = _squares(level, off)
        variance = float((w + taken) ** 2 @ spread + (taken**2 + w**2 @ weights) @ squares)
    changing = float(w @ of_period) + drift
    # The drift is known from the means of the periods alone.
    of_changing = float(w**2 @ of_period**2) / (freedom / 2 + 1) + 4.0 * drift**2 / freedom
    of_noise = bounds_of(changing, of_changing)
    of_distortion, rest = bounds_of(distortion, variance), total - changing - distortion
    # The rest has the error of the distortion, and varies with it at lines where both are.
    linear = np.maximum((power - noise)[on] - at_lines, 0.0)
    cross = 2.0 * linear * (at_lines + noise[on]) + noise[on] ** 2
    beyond = NORMAL_95 * math.sqrt(float(w[on] ** 2 @ cross) / count)
    up, down = (math.hypot(distortion - bound, beyond) for bound in of_distortion)
    if not lines.by_realisations and lines.levels is None:
        at_lines = np.interp(np.flatnonzero(on), np.flatnonzero(off), level[off])
    levels = np.array([noise[on], np.maximum(at_lines - noise[on] * lines.by_realisations, 0.0)])
    even = np.arange(len(on)) % 2 == 0
    even_share = math.nan
    if distortion > 0.0 and not on[even].any():
        even_share = min(max(float(w[even] @ level[even]) / distortion, 0.0), 1.0)
    # What is at lines left out tells more, or less, than is in the error.
    stated = min(distortion, max(total - changing, 0.0))
    log_p = np.log(np.maximum(p_values, np.finfo(float).tiny))
    parts = ErrorParts(
        name=name,
        error_percent=100.0 * math.sqrt(total),
        noise=Part.of(changing, of_noise),
        distortion=Part.of(stated, (min(of_distortion[0], stated), of_distortion[1])),
        rest=Part.of(rest, (rest - down, rest + up)),
        even_share=even_share,
    )
    return parts, float(chdtrc(2 * len(log_p), -2.0 * log_p.sum())), levels


def _squares(level: Array, off: Flags) -> Array:
    """Variances of what is at lines left out about its level between its neighbours, (F,). Squared
    levels, and where they change more from line to line, squared differences."""
    squares = np.zeros(len(level))
    for parity in (0, 1):
        lines = off & (np.arange(len(level)) % 2 == parity)
        if lines.sum() < 2:
            continue
        padded = np.pad(level[lines], 1, mode="reflect")
        beside = (padded[:-2] + padded[2:]) / 2.0
        mean = (2.0 * beside + level[lines]) / 3.0
        squares[lines] = np.maximum(mean**2, (level[lines] - beside) ** 2 / 1.5)
    return squares


def _allowed(u: Complex, power: Array, driven: Array, wrong: Complex, lines: Lines) -> Array:
    """Power that a linear response may leave at lines with little input, (F,). It is as wrong there
    as on the whole, and as at the nearest excited lines; beyond these it may be twice that of the
    model.  Inputs (M, F, m), powers of error and response (F,), and what the model misses at
    excited lines, (E, m)."""
    on, w, numbers = lines.excited, lines.weights, np.arange(len(power))
    whole = float(w[on] @ power[on]) / max(float(w[on] @ driven[on]), ROUNDING)
    inputs = np.mean(np.abs(u) ** 2, axis=0).T
    nearest = [np.interp(numbers, np.flatnonzero(on), gain) for gain in np.abs(wrong.T) ** 2]
    of_inputs = [gain * own_power for gain, own_power in zip(nearest, inputs, strict=True)]
    beyond = (numbers < np.argmax(on)) | (np.cumsum(on) == on.sum())
    share = np.where(beyond, 1.0, min(whole, 1.0))
    return share * driven + len(inputs) * np.sum(of_inputs, axis=0) + ROUNDING
