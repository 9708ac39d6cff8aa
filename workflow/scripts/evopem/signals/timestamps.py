"""The sampling rate of time stamps: uniform ones, those of a coarse clock, and uneven ones."""

from dataclasses import dataclass
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from evopem.arrays import Array
from evopem.errors import InputError
from evopem.signals.time_units import TIME_UNITS, stated_unit

STEP_TOLERANCE = 0.1  # a step may differ from the median step by this share of it
GRID_TOLERANCE = 1e-3  # a stamp may be off an even grid by half a step or this share of the whole
RATE_TOLERANCE = 1e-3  # a stated rate may differ from that of the stamps by this share
_SECONDS_1990, _SECONDS_2050 = 6.3e8, 2.5e9
_DAYS_2000, _DAYS_OF_A_CENTURY = (36526, 730486), 36525  # as spreadsheets and MATLAB count them
_LARGEST_STEP_OF_DAYS = 1e-4  # smaller ones are rather days, 8 s apart at most, than of 10 kHz
_LOGGED = 8640, 5760, 4320, 2880, 1440, 720, 288, 144, 96, 48, 24, 12, 8, 6, 4, 2, 1  # times a day
_STEPS_OF_LOGGERS = 1.0 / np.array(_LOGGED)  # likely days too: 10 s to a day
_LARGEST_UPTIME = 1e18  # nanoseconds since 1970 from here on: they would be 31 years of uptime

TICK_SPREAD = 0.1  # ticks of one clock may differ by this share, as 15 and 16 ms do of 15.6 ms
KNOWN = 0.01  # largest relative error of a rate that stamps of a coarse clock may leave
FEWEST, SMALLEST_SHARE = 10, 0.1  # steps of each length that are no repeated or lost samples
_HALVINGS = 60  # of the interval in which the step is searched; as many as a double has digits

LONGEST_GAP, MOST_IN_GAPS = 20, 0.1  # steps, and share of samples, that are interpolated at most
GAP = 1.5  # two stamps farther apart than so many usual steps have a gap between them
BLOCKS, SHORTEST_BLOCK = 8, 25  # parts whose mean steps are compared, and steps in each at least
LARGEST_CHANGE, SIGNIFICANT = 0.03, 6.0
"""Mean steps that differ by more than this share, and this many standard errors, are of two
rates."""
CLOSEST = 1e-6  # two stamps closer than this share of the usual step are the same time


@dataclass(frozen=True)
class Unevenness:
    """How far time stamps are from even ones."""

    in_gaps: int  # missing samples: between stamps that are more than :data:`GAP` usual steps apart
    longest_gap: float  # largest distance of two neighbouring stamps, in steps
    largest_shift: float  # largest distance of a stamp from the nearest sample, in steps
    # resolution of a coarse clock whose stamps are otherwise even, in steps; 0.0 for others
    tick: float = 0.0


@dataclass(frozen=True, eq=False)
class Timing:
    """What time stamps say of the samples."""

    rate: float  # Hz
    # of stamps that an even grid took the place of, and of those of a coarse clock
    unevenness: Unevenness | None = None
    positions: Array | None = None  # (N,) the stamps on an even grid, in steps from the first one

    def on_grid(self, values: Array) -> Array:
        """A signal at even times: as it is, or linear between the stamps around each sample."""
        if self.positions is None:
            return values
        return np.interp(np.arange(round(self.positions[-1]) + 1), self.positions, values)


class CoarseClock(NamedTuple):
    """A clock whose ticks are all that keeps the stamps of even samples from being even."""

    tick: float  # resolution of the clock, in the unit of the stamps
    step: float  # of the even times from which every stamp is less than a tick away
    relative_error: float  # the step is known to this share of itself: a tick over the whole time


_EVEN = (
    "bring the recording to a constant rate (of a file: uneven_time: interpolate), or leave time"
    " out and state sampling_rate"
)


class _Stamps(NamedTuple):
    """What an error says of time stamps."""

    source: str
    place: str
    unit: str  # of a number of time, where it is known

    def refuse(self, problem: str, sample: int, remedy: str = _EVEN) -> NoReturn:
        """Say why stamps cannot be used, at a sample from 0 on."""
        raise InputError(self.source, problem, remedy, f"{self.place}, sample {sample + 1}")


def timing(
    stamps: NDArray,
    source: str,
    name: str,
    unit: str = "",
    stated_rate: float | None = None,
    time_unit: str | None = None,
    interpolate: bool = False,
) -> Timing:
    """What time stamps, (N,) numbers, dates (datetime64) or durations, say of the samples.

    Their unit is `time_unit`, else the one that the file states, as `unit` or in the name. Without
    one, numbers with a fraction are seconds; whole numbers are taken in the unit in which they
    agree with the stated rate (Hz), which is then returned, and large ones as nanoseconds since
    1970.

    The stamps must be uniform, or uniform but for the ticks of a coarse clock. With `interpolate`
    others are brought to an even grid, if not too many samples are missing.
    """
    place = f'time "{name}"' if name else "time"
    if time_unit is not None and time_unit not in TIME_UNITS:
        choice = f"set time_unit to one of {', '.join(TIME_UNITS)}"
        raise InputError(source, f'"{time_unit}" is no known unit of time', choice, place)
    if stamps.size < 2:
        raise InputError(source, "there are fewer than two time stamps", "give a longer recording")
    if stamps.dtype.kind not in "iufMm":
        raise InputError(source, "the channel holds no times", "choose another channel", place)
    dates = stamps.dtype.kind in "Mm"
    positions = unevenness = None
    tolerance = RATE_TOLERANCE
    known = "s" if dates else time_unit or stated_unit(name, unit, source, place)
    named = _Stamps(source, place, f" {known}" if known else "")
    ticks = _ticks(stamps, named)
    # From the first stamp on, so that dates in nanoseconds keep all their digits as floats.
    times = (ticks - ticks[0]).astype(np.float64) * (TIME_UNITS["ns"] if dates else 1.0)
    clock = None if has_even_steps(times) else coarse_clock(times)
    if clock:
        step, tolerance = clock.step, max(tolerance, clock.relative_error)
        tick = clock.tick / step
        unevenness = Unevenness(0, float(np.diff(times).max()) / step, tick, tick)
    elif interpolate:
        step, unevenness = _even_grid(times, named)
        positions = times / step
    else:
        step = _uniform_step(times, named)
    scale = TIME_UNITS[known] if known else _scale(ticks, step, stated_rate, tolerance, named)
    rate = float(f"{1.0 / (step * scale):.9g}")
    if stated_rate is not None:
        if abs(rate / stated_rate - 1.0) > tolerance:
            problem = f"the time stamps give {rate:g} Hz and the stated rate is {stated_rate:g} Hz"
            remedy = "correct one of them or leave one out, or set time_unit if that of the stamps"
            raise InputError(source, problem, f"{remedy} is another one", place)
        rate = float(stated_rate)
    return Timing(rate, unevenness, positions)


def is_time(signal: Array, sampling_rate: float) -> bool:
    """Whether a signal increases by the sampling period, in one of `TIME_UNITS`, throughout."""
    step = float(np.diff(signal).mean())
    return has_even_steps(signal) and any(
        abs(step * seconds * sampling_rate - 1.0) < RATE_TOLERANCE
        for seconds in TIME_UNITS.values()
    )


def has_even_steps(times: Array) -> bool:
    """Whether the steps of times are positive and alike."""
    steps = np.diff(times)
    usual = float(np.median(steps))
    return usual > 0.0 and bool((np.abs(steps - usual) <= STEP_TOLERANCE * usual).all())


def _ticks(stamps: NDArray, named: _Stamps) -> NDArray:
    """The stamps as 64-bit numbers, in which differences do not overflow."""
    if stamps.dtype.kind in "Mm":
        if np.isnat(stamps).any():
            named.refuse("the time stamp is missing", int(np.argmax(np.isnat(stamps))))
        return stamps.astype(f"{stamps.dtype.kind}8[ns]").astype(np.int64)
    if stamps.dtype.kind == "u" and stamps.max() > np.iinfo(np.int64).max:
        named.refuse(f"the time stamp is {stamps.max()}", int(np.argmax(stamps)))
    ticks = stamps.astype(np.float64 if stamps.dtype.kind == "f" else np.int64)
    if not np.isfinite(ticks).all():
        first = int(np.argmin(np.isfinite(ticks)))
        named.refuse(f"the time stamp is {ticks[first]}", first)
    return ticks


def _refuse_same_times(times: Array, closest: float, named: _Stamps) -> NoReturn:
    """Refuse times that do not increase; two times closer than ``closest`` are the same."""
    steps = np.diff(times)
    equal = np.flatnonzero(steps <= closest) + 1
    first = int(equal[0])
    back = -float(steps[first - 1])
    problem = f"{back:g}{named.unit} before that" if back > closest else "that"
    problem = f"the time does not increase: it is {problem} of sample {first}"
    if equal.size > 1:
        problem += f", and there are {equal.size - 1} more such samples"
    named.refuse(
        problem,
        first,
        "remove rows whose time is not later than the one before; if the clock is too coarse or"
        " was set back, leave time out and state sampling_rate",
    )


def _uniform_step(times: Array, named: _Stamps) -> float:
    """The mean step of uniform times that begin at 0."""
    steps = np.diff(times)
    if steps.min() <= 0.0:
        _refuse_same_times(times, 0.0, named)
    usual = float(np.median(steps))
    uneven = np.abs(steps - usual) > STEP_TOLERANCE * usual
    if uneven.any():
        first = int(np.argmax(uneven))
        unit = named.unit
        problem = f"the step to this sample is {steps[first]:g}{unit} where the usual one is"
        named.refuse(f"{problem} {usual:g}{unit}", first + 1)
    step = float(times[-1] / steps.size)
    off = np.abs(times - step * np.arange(times.size))
    allowed = max(0.5 * step, GRID_TOLERANCE * float(times[-1]))
    if off.max() > allowed:
        first = int(np.argmax(off > allowed))
        named.refuse(f"the time is {off[first]:g}{named.unit} off an even grid", first)
    return step


def _scale(
    ticks: NDArray, step: float, stated_rate: float | None, tolerance: float, named: _Stamps
) -> float:
    """Seconds in the unit of stamps for which the file states none."""
    if not np.array_equal(ticks, np.round(ticks)):
        begun = float(ticks[0])
        days = any(first < begun < first + _DAYS_OF_A_CENTURY for first in _DAYS_2000)
        usual = np.abs(step / _STEPS_OF_LOGGERS - 1.0).min() < RATE_TOLERANCE
        if stated_rate is None and days and (step < _LARGEST_STEP_OF_DAYS or usual):
            rates = f"days ({1.0 / (step * TIME_UNITS['d']):g} Hz) or seconds ({1.0 / step:g} Hz)"
            problem = f"the time stamps, {begun:.9g} at first and {step:.3g} apart, may be {rates}"
            raise InputError(named.source, problem, "set time_unit to d or s", named.place)
        return 1.0
    if stated_rate is not None:
        for scale in TIME_UNITS.values():
            if abs(1.0 / (step * scale * stated_rate) - 1.0) <= tolerance:
                return scale
        return 1.0
    if float(ticks[0]) >= _LARGEST_UPTIME:
        return TIME_UNITS["ns"]
    choice = f"set time_unit to one of {', '.join(TIME_UNITS)} (ms would give {1e3 / step:g} Hz)"
    for unit, scale in TIME_UNITS.items():
        if _SECONDS_1990 <= float(ticks[0]) * scale <= _SECONDS_2050 and step * scale < 60.0:
            choice = f"set time_unit to {unit} if they count from 1970 ({1 / (step * scale):g} Hz)"
            choice += f", else to one of {', '.join(TIME_UNITS)}"
            break
    units = "seconds, milliseconds or microseconds"
    problem = f"the time stamps are whole numbers {step:g} apart, which may be {units}"
    raise InputError(named.source, problem, choice, named.place)


def coarse_clock(times: Array) -> CoarseClock | None:
    """The clock of time stamps, (N,) from 0, that are even but for its resolution; else None.

    Stamps of even samples, cut or rounded to ticks, have steps of two lengths, one tick apart (0
    and 10 ms, or 3 and 4 ms), and lie in a band one tick wide around even times. Samples that are
    lost or repeated irregularly leave that band; regular ones would not, so that a tick of more
    than half the usual step has to show in many steps.
    """
    steps = np.diff(times)
    shortest, longest = float(steps.min(initial=np.inf)), float(steps.max(initial=0.0))
    if steps.size < 2 or shortest < 0.0 or shortest == longest:
        return None
    long = steps > 0.5 * (shortest + longest)
    tick = float(np.median(steps[long]) - np.median(steps[~long]))
    spread = max(float(np.ptp(steps[long])), float(np.ptp(steps[~long])))
    if spread > TICK_SPREAD * tick:
        return None
    usual, rare = float(np.median(steps)), min(int(long.sum()), int((~long).sum()))
    if 0.0 < usual < 2.0 * tick and rare < max(FEWEST, SMALLEST_SHARE * steps.size):
        return None
    # The spread of stamps around even times is a convex function of their step: its slope tells on
    # which side the smallest lies.
    numbers = np.arange(times.size, dtype=np.float64)
    low, high = 0.0, longest
    for _ in range(_HALVINGS):
        step = 0.5 * (low + high)
        off = times - step * numbers
        if np.argmax(off) > np.argmin(off):
            low = step
        else:
            high = step
    error = tick / float(times[-1])
    if float(np.ptp(times - step * numbers)) > (1.0 + TICK_SPREAD) * tick or error > KNOWN:
        return None
    return CoarseClock(tick, step, error)


def _even_grid(times: Array, named: _Stamps) -> tuple[float, Unevenness]:
    """The usual step of times, some of which may be late or missing; it divides the whole time."""
    steps = np.diff(times)
    usual = float(np.median(steps))
    if steps.min() <= CLOSEST * usual:
        _refuse_same_times(times, CLOSEST * usual, named)
    _refuse_other_rate(steps, usual, named)
    # The median of a few irregular steps is not exact enough to divide the whole time by.
    total = max(int(np.round(steps / usual).sum()), 1)
    step = float(times[-1]) / total
    missing = int(np.sum(np.round(steps[steps > GAP * usual] / step) - 1))
    longest = float(steps.max() / step)
    if longest > LONGEST_GAP or missing > MOST_IN_GAPS * total:
        named.refuse(
            f"{missing} samples of {total + 1} are missing, and the longest gap ends at this sample"
            f" after {longest:.3g} usual steps; up to {100 * MOST_IN_GAPS:g} % and {LONGEST_GAP}"
            " steps are interpolated",
            int(np.argmax(steps)) + 1,
            "give what was recorded without gaps, as several files of one data set",
        )
    positions = times / step
    shift = float(np.abs(positions - np.round(positions)).max())
    return step, Unevenness(missing, longest, shift)


def _refuse_other_rate(steps: Array, usual: float, named: _Stamps) -> None:
    """Refuse stamps whose mean step changes in the course of the recording. The steps that are
    missing in a gap are counted.  What jitter does to the mean step of a block follows from its
    steps."""
    blocks = min(BLOCKS, steps.size // SHORTEST_BLOCK)
    if blocks < 2:
        return
    edges = np.linspace(0, steps.size, blocks + 1).astype(int)
    medians = [float(np.median(part)) for part in np.split(steps, edges[1:-1])]
    counts = np.maximum(np.round(steps / np.repeat(medians, np.diff(edges))), 1.0)
    mean = np.add.reduceat(steps, edges[:-1]) / np.add.reduceat(counts, edges[:-1])
    off = steps - counts * np.repeat(mean, np.diff(edges))
    error = float(off.std()) * float(np.sqrt(2.0 / np.diff(edges).min()))
    low, high = int(np.argmin(mean)), int(np.argmax(mean))
    change = float(mean[high] - mean[low])
    if change > LARGEST_CHANGE * usual and change > SIGNIFICANT * error:
        first, last = sorted((low, high))
        unit = named.unit
        named.refuse(
            f"the rate changes: the mean step is {mean[first]:.4g}{unit} from this sample on and"
            f" {mean[last]:.4g}{unit} from sample {edges[last] + 1} on",
            int(edges[first]),
            "give the parts of one rate as data sets of their own, or resample the recording",
        )
