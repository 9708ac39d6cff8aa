"""Resampling; the level of outputs; Box-Cox transform and high-pass filter, and their inverses."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array, one_blas_thread
from evopem.errors import InputError
from evopem.signals.least_squares import triangle_of
from evopem.signals.recording import Recording

PASS_BAND = 0.9  # upper edge of the pass band, as a share of the new Nyquist frequency
STOP_BAND_DB = 90.0  # design attenuation (dB) from the new Nyquist frequency on; 80 dB are promised
LARGEST_FACTOR = 10_000  # largest numerator or denominator of the ratio of the two rates
BOX_COX_RANGE = (-5.0, 5.0)  # where ``auto`` looks for the Box-Cox parameter


@dataclass(frozen=True)
class HighPass:
    """The filter ``((1 - q^-1) / (1 - pole q^-1))**times``, of pole 0 where it is not alone."""

    times: int = 0
    pole: float = 0.0

    def __str__(self) -> str:
        plain = ("none", "differences", "second differences")[self.times]
        return f"high-pass filter of pole {self.pole:g}" if self.pole else plain


NO_FILTER = HighPass()


def positive_shift(*signals: Array) -> float:
    """The shift that makes every sample of all signals, (N,) each, positive; 0.0 when they are.

    The smallest lands one standard deviation of the first signal above zero: a rule free of units,
    and far enough from the transform's singularity that no single sample dominates.
    """
    smallest = min(float(signal.min()) for signal in signals)
    return 0.0 if smallest > 0.0 else float(np.std(signals[0])) - smallest


def box_cox(signal: Array, parameter: float, shift: float, source: str = "box_cox") -> Array:
    """``((y + shift)**parameter - 1) / parameter``, the logarithm at 0 (Box & Cox 1964)."""
    shifted = signal + shift
    if shifted.min() <= 0.0:
        first = int(np.argmax(shifted <= 0.0))
        problem = (
            f"the output plus its shift {shift:g} is {shifted[first]:g}, and the transform needs"
            " positive values"
        )
        raise InputError(source, problem, "use box_cox: none", f"sample {first + 1}")
    with np.errstate(over="ignore"):
        transformed = scipy.special.boxcox(shifted, parameter)
        back = invert_box_cox(transformed, parameter, shift)
    if not float(np.max(np.abs(back - signal))) <= 1e-6 * float(np.ptp(signal)):
        problem = (
            f"the parameter {parameter:g} flattens this output so far that it could not be"
            " transformed back"
        )
        raise InputError(source, problem, "choose a parameter nearer to 1 or box_cox: none")
    return transformed


def invert_box_cox(signal: Array, parameter: float, shift: float) -> Array:
    """Undo `box_cox`; NaN where a value lies outside the transform's range."""
    # boxcox takes the logarithm below 1e-19, inv_boxcox the exponential at zero only.
    return scipy.special.inv_boxcox(signal, parameter if abs(parameter) >= 1e-19 else 0.0) - shift


def likeliest_box_cox(signal: Array, shift: float, source: str = "box_cox") -> float:
    """The Box-Cox parameter in `BOX_COX_RANGE` of largest likelihood for a normal distribution."""
    options = {"bounds": BOX_COX_RANGE, "method": "bounded", "options": {"xatol": 1e-8}}
    within_range = partial(scipy.optimize.minimize_scalar, **options)
    # The likelihood's maximiser does not depend on the unit; a unit scale avoids overflow.
    shifted = signal + shift
    scaled = shifted / np.exp(np.mean(np.log(shifted)))
    parameter = float(scipy.stats.boxcox_normmax(scaled, method="mle", optimizer=within_range))
    low, high = BOX_COX_RANGE
    if not low + 1e-3 < parameter < high - 1e-3:
        problem = f"no parameter between {low:g} and {high:g} makes the output normal"
        raise InputError(source, problem, "give a number or box_cox: none")
    return parameter


def difference(
    signals: Array, times: int, pole: float = 0.0
) -> tuple[Array, tuple[tuple[float, ...], ...]]:
    """Pass signals, (N, channels), through ``(1 - q^-1) / (1 - pole q^-1)`` `times` < N times.

    At pole 0 they are differenced. A pole above takes a level away that follows what lies before,
    ``level(t + 1) = pole level(t) + (1 - pole) y(t)``, from the mean of the first 1 / (1 - pole)
    samples on. The second value holds the first level of the signals, of what is left, …
    """
    initial = []
    left = np.array(signals, dtype=np.float64)
    for _ in range(times):
        first = left[: max(round(1.0 / (1.0 - pole)), 1)].mean(axis=0)
        initial.append(tuple(first.tolist()))
        later, _ = scipy.signal.lfilter([1.0 - pole], [1.0, -pole], left[1:], 0, pole * first[None])
        left = left[1:] - np.vstack([first, later[:-1]])
    return left, tuple(initial)


def invert_difference(
    differenced: Array, initial: tuple[tuple[float, ...], ...], pole: float = 0.0
) -> Array:
    """Undo `difference`, to ``eps * N**times``; of a pole above 0 the first sample is a level."""
    signals = np.array(differenced, dtype=np.float64)
    for first in reversed(initial):
        levels = np.cumsum(np.vstack([first, (1.0 - pole) * signals]), axis=0)
        signals = np.vstack([levels[:1], levels[:-1] + signals])
    return signals


def resample_recording(recording: Recording, sampling_rate: float, source: str) -> Recording:
    """Bring all channels of a recording to a lower sampling rate.

    They pass the same filter (see `resample_signal`), so their relations, delay included,
    are unchanged below the pass band's edge. An equal rate returns the recording as it is.
    """
    old = recording.sampling_rate
    if sampling_rate > old:
        problem = (
            f"{sampling_rate:g} Hz is above the recording's {old:g} Hz and would add an empty band"
        )
        raise InputError(source, problem, "choose a lower rate or leave the key out")
    ratio = Fraction(sampling_rate / old).limit_denominator(LARGEST_FACTOR)
    if ratio == 1:
        return recording
    if ratio == 0 or abs(float(ratio) * old / sampling_rate - 1.0) > 1e-9:
        problem = (
            f"{sampling_rate!r} Hz and the recording's {old!r} Hz are not in the ratio of whole"
            f" numbers up to {LARGEST_FACTOR}"
        )
        raise InputError(source, problem, "choose a rate that divides more evenly")
    return replace(
        recording,
        inputs=resample_signal(recording.inputs, ratio),
        outputs=resample_signal(recording.outputs, ratio),
        sampling_rate=float(sampling_rate),
    )


def resample_signal(signal: Array, ratio: Fraction) -> Array:
    """A signal, (N,) or (N, channels), at a rate lower by a ratio: ceil(N * ratio) samples.

    The filter is linear-phase, and its delay is taken out. Beyond its ends (about 60 new samples)
    the signal is continued by odd reflection, which keeps its level and slope.
    """
    return scipy.signal.resample_poly(
        signal, *ratio.as_integer_ratio(), window=anti_alias_filter(ratio), padtype="antireflect"
    )


def anti_alias_filter(ratio: Fraction) -> Array:
    """Kaiser FIR at the intermediate rate (old rate times numerator), unit gain at zero.

    Kaiser, J. F. (1974), "Nonrecursive digital filter design using the I0-sinh window".
    """
    # The new Nyquist frequency, as a share of the intermediate rate's own.
    nyquist = 1.0 / ratio.denominator
    length, beta = scipy.signal.kaiserord(STOP_BAND_DB, (1.0 - PASS_BAND) * nyquist)
    length |= 1  # an odd length has a whole-sample delay, which can be taken out exactly
    return scipy.signal.firwin(length, 0.5 * (1.0 + PASS_BAND) * nyquist, window=("kaiser", beta))


# Lags of inputs and output in the regression, and the samples that a coefficient needs at least.
MOST_LAGS = 30
SAMPLES_PER_COEFFICIENT = 10
ROWS = 4096  # rows of the regression that are held in memory at a time
NORMAL_99 = 2.576  # quantile of the normal distribution that an estimate must exceed, two-sided 1 %
# Diagonal elements of the triangle below this share of their column's length are rounding.
RANK_TOLERANCE = 1e-10


def output_levels(recording: Recording) -> tuple[float, ...]:
    """Level of each output at which inputs at their means would hold it, in its unit.

    What the inputs before a short recording add to its beginning shifts the mean. A regression on
    past inputs, past outputs and a constant is free of it (Ljung 1999, section 14.1). Its level
    takes the place of the mean where it differs at 1 % and the output does not drift.
    """
    u = recording.inputs - recording.inputs.mean(axis=0)
    deviations = u.std(axis=0)
    u = u[:, deviations > 0.0] / deviations[deviations > 0.0]
    starts = recording.segment_starts[1:]
    return tuple(_level(u, np.ascontiguousarray(y), starts) for y in recording.outputs.T)


def _level(u: Array, output: Array, starts: tuple[int, ...]) -> float:
    mean, deviation = float(output.mean()), float(output.std())
    coefficients = 1 + max(u.shape[1], 1)
    lags = min(MOST_LAGS, len(output) // (coefficients * SAMPLES_PER_COEFFICIENT))
    if lags < 1 or not deviation > 0.0:
        return mean
    segments = zip(np.split(u, starts), np.split((output - mean) / deviation, starts), strict=True)
    # The bits must not depend on how many threads the machine's BLAS would take.
    with one_blas_thread():
        triangle = triangle_of(rows for part in segments for rows in regression_rows(*part, lags))
        return mean + deviation * _shift(triangle, lags, len(output) - lags * (1 + len(starts)))


def regression_rows(u: Array, y: Array, lags: int) -> Iterator[Array]:
    """Past outputs, present and past inputs, 1 and the output, in blocks of rows."""
    for first in range(lags, len(y), ROWS):
        stop = min(first + ROWS, len(y))
        columns = [y[first - k : stop - k] for k in range(1, lags + 1)]
        columns += [signal[first - k : stop - k] for signal in u.T for k in range(lags + 1)]
        yield np.column_stack([*columns, np.ones(stop - first), y[first:stop]])


def _shift(triangle: Array, lags: int, rows: int) -> float:
    """How much the level lies above the mean, in standard deviations; 0 where it is not known."""
    count = triangle.shape[1] - 2  # of the coefficients beside the constant
    is_short = len(triangle) <= max(count + 1, 0)
    if is_short or abs(triangle[count, count]) <= RANK_TOLERANCE * rows**0.5:
        return 0.0
    noise = abs(triangle[-1, -1]) / math.sqrt(rows - count - 1)
    if abs(triangle[count, -1]) <= NORMAL_99 * noise:
        return 0.0
    inverse = np.linalg.pinv(triangle[: count + 1, : count + 1], rcond=RANK_TOLERANCE)
    coefficients = inverse @ triangle[: count + 1, -1]
    total = 1.0 - float(coefficients[:lags].sum())
    error = noise * float(np.linalg.norm(inverse[:lags].sum(axis=0)))
    return float(coefficients[count]) / total if abs(total) > NORMAL_99 * error else 0.0
