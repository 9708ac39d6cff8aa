"""The sampling rate of time stamps, and the check that they are uniform."""

from __future__ import annotations

import re
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.coarse_clock import CoarseClock, coarse_clock

STEP_TOLERANCE = 0.1
"""A step may differ from the median step by this share of it."""
GRID_TOLERANCE = 1e-3
"""A stamp may differ from the uniform grid by half a step or this share of the record."""
RATE_TOLERANCE = 1e-3
"""A stated rate may differ from that of the stamps by this share."""

TIME_UNITS = {
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
    "d": 86400.0,
}
"""Seconds in each unit of time."""

_SPELLINGS = {
    "s": "s sec secs second seconds sek sekunde sekunden seconde secondes segundo segundos",
    "ms": "ms msec msecs msek millis millisec millisecs millisecond milliseconds millisekunden",
    "us": "us µs μs usec usecs µsec μsec micros microsec microsecs microsecond microseconds"
    " mikrosekunden",
    "ns": "ns nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds nanosekunden",
    "min": "min mins minute minutes minuten",
    "h": "h hr hrs hour hours stunde stunden",
    "d": "d day days tag tage",
}
_UNIT_OF = {text: unit for unit, texts in _SPELLINGS.items() for text in texts.split()}

_TIME_WORDS = {
    "t", "time", "times", "zeit", "temps", "tiempo", "tempo", "timestamp", "timestamps", "stamp",
    "stamps", "clock", "elapsed", "uptime", "runtime", "abszeit", "messzeit",
}  # fmt: skip
"""Words that begin the name of a time channel, and after which a unit may follow."""
_OTHER_WORDS = {
    "a", "abs", "absolute", "axis", "b", "base", "channel", "col", "column", "date", "daq", "gps",
    "in", "index", "local", "log", "of", "raw", "rel", "relative", "sample", "sampling", "series",
    "since", "sim", "start", "the", "utc", "value", "values", "vec", "vector", "x", "y", "unix",
    "epoch", "measured", "measurement", "out", "data", "test",
}  # fmt: skip
"""Words in the name of a time channel that are no units."""

_BRACKET = re.compile(r"[\[({<]\s*([^\[\](){}<>]*?)\s*[\])}>]\s*$")
_CAMEL_CASE = re.compile(r"(?<=[a-z])(?=[A-Z])")
_JOINED = re.compile(r"(?:time|t)(ms|us|µs|ns|msec|usec|nsec|sec|min)")
_SECONDS_1990, _SECONDS_2050 = 6.3e8, 2.5e9
_LARGEST_UPTIME = 1e18
"""Whole numbers from here on are nanoseconds since 1970: they would be 31 years of uptime."""


def sampling_rate_of(
    stamps: NDArray,
    source: str,
    name: str,
    unit: str = "",
    stated_rate: float | None = None,
    time_unit: str | None = None,
    step: float | None = None,
) -> float:
    """Sampling rate (Hz) of uniform time stamps.

    The unit of the stamps is `time_unit`; without it the one that the file states, as `unit` or
    in the name ("time_ms", "t [µs]"). A unit that is stated and not known is refused. Where none
    is stated, numbers with a fraction are seconds; whole numbers are taken in the unit in which
    they agree with the stated rate, and as nanoseconds since 1970 where they are that large.
    Other whole numbers are refused.

    The stamps must increase. Each step must be within 10 % of the median step, and each stamp
    within half a step, or 0.1 % of the record, of the uniform grid from the first stamp to the
    last. Or they are those of even times but for the ticks of a coarse clock
    (:func:`.coarse_clock`), which neighbouring samples may share.

    The stamps, (N,), are numbers, dates (datetime64) or durations (timedelta64). A stated rate (Hz)
    with which they agree is returned. With the `step` of an even grid that uneven stamps are
    brought to, in their unit, they need not be uniform.
    """
    place = _place(name)
    if time_unit is not None and time_unit not in TIME_UNITS:
        raise InputError(
            source,
            f'"{time_unit}" is no known unit of time',
            f"set time_unit to one of {', '.join(TIME_UNITS)}",
            place,
        )
    ticks = _ticks(stamps, source, place)
    tolerance = RATE_TOLERANCE
    if step is None:
        times = _from_first(ticks, stamps)
        clock = clock_of_uneven(times)
        step = clock.step if clock else _uniform_step(times, source, place, unit_of(stamps))
        tolerance = max(tolerance, clock.relative_error) if clock else tolerance
    if stamps.dtype.kind in "Mm":
        scale = TIME_UNITS["s"]
    elif time_unit is not None:
        scale = TIME_UNITS[time_unit]
    else:
        stated = _stated_unit(name, unit, source, place)
        unstated = ticks, step, stated_rate, tolerance
        scale = TIME_UNITS[stated] if stated else _scale(*unstated, source, place)
    rate = float(f"{1.0 / (step * scale):.9g}")
    if stated_rate is None:
        return rate
    if abs(rate / stated_rate - 1.0) > tolerance:
        raise InputError(
            source,
            f"the time stamps give {rate:g} Hz and the stated sampling rate is {stated_rate:g} Hz",
            "correct one of them or leave one out, or set time_unit if that of the stamps is"
            " another one",
            place,
        )
    return float(stated_rate)


def elapsed(stamps: NDArray, source: str, name: str) -> NDArray[np.float64]:
    """Time since the first stamp, in the unit of the stamps; of dates in seconds."""
    return _from_first(_ticks(stamps, source, _place(name)), stamps)


def unit_of(stamps: NDArray) -> str:
    """What follows a number of :func:`elapsed` in a message: the unit, where it is known."""
    return " s" if stamps.dtype.kind in "Mm" else ""


def seconds_of(unit: str) -> float | None:
    """Seconds in a unit of time as files spell it ("ms", "msec", "Sekunden"); None if unknown."""
    spelled = _spelled(unit)
    return TIME_UNITS[_UNIT_OF[spelled]] if spelled in _UNIT_OF else None


def names_time(name: str) -> bool:
    """Whether the name of a channel holds a word for time."""
    return not _TIME_WORDS.isdisjoint(map(_spelled, _words(name)))


def is_time(signal: NDArray[np.float64], sampling_rate: float) -> bool:
    """Whether a signal increases by the sampling period, in one of `TIME_UNITS`, throughout."""
    steps = np.diff(signal)
    step = float(steps.mean())
    uniform = step > 0.0 and float(np.abs(steps - step).max()) <= STEP_TOLERANCE * step
    return uniform and any(
        abs(step * seconds * sampling_rate - 1.0) < RATE_TOLERANCE
        for seconds in TIME_UNITS.values()
    )


def _place(name: str) -> str:
    return f'time "{name}"' if name else "time"


def _from_first(ticks: NDArray, stamps: NDArray) -> NDArray[np.float64]:
    """From the first stamp on, so that dates in nanoseconds keep all their digits as floats."""
    elapsed = (ticks - ticks[0]).astype(np.float64)
    return elapsed * TIME_UNITS["ns"] if stamps.dtype.kind in "Mm" else elapsed


def _ticks(stamps: NDArray, source: str, place: str) -> NDArray:
    """The stamps as 64-bit numbers, in which differences do not overflow."""
    if stamps.size < 2:
        raise InputError(source, "there are fewer than two time stamps", "give a longer recording")
    if stamps.dtype.kind in "Mm":
        if np.isnat(stamps).any():
            first = int(np.argmax(np.isnat(stamps)))
            _refuse(source, place, first, "the time stamp is missing")
        return stamps.astype(f"{stamps.dtype.kind}8[ns]").astype(np.int64)
    if stamps.dtype.kind not in "iuf":
        raise InputError(source, "the channel holds no times", "choose another channel", place)
    if stamps.dtype.kind == "u" and stamps.max() > np.iinfo(np.int64).max:
        _refuse(source, place, int(np.argmax(stamps)), f"the time stamp is {stamps.max()}")
    ticks = stamps.astype(np.float64 if stamps.dtype.kind == "f" else np.int64)
    if not np.isfinite(ticks).all():
        first = int(np.argmin(np.isfinite(ticks)))
        _refuse(source, place, first, f"the time stamp is {ticks[first]}")
    return ticks


def clock_of_uneven(times: NDArray[np.float64]) -> CoarseClock | None:
    """The coarse clock of times whose steps are not uniform; None for uniform steps, or none such.

    ``times``, (N,), begin with 0.
    """
    steps = np.diff(times)
    usual = float(np.median(steps))
    uniform = np.abs(steps - usual) <= STEP_TOLERANCE * usual
    return None if usual > 0.0 and uniform.all() else coarse_clock(times)


def refuse_same_times(
    times: NDArray[np.float64], closest: float, source: str, place: str, unit: str = ""
) -> NoReturn:
    """Refuse times that do not increase, and name the first two samples and how many there are.

    Two times closer than ``closest`` are the same; ``unit`` follows a number of times.
    """
    steps = np.diff(times)
    found = np.flatnonzero(steps <= closest) + 1
    first = int(found[0])
    back = -float(steps[first - 1])
    problem = "the time does not increase: it is "
    problem += (
        f"{back:g}{unit} before that of sample {first}"
        if back > closest
        else f"that of sample {first}"
    )
    if found.size > 1:
        problem += f", and there are {found.size - 1} more such samples"
    raise InputError(
        source,
        problem,
        "remove rows whose time is not later than the one before; if only the clock is too coarse,"
        " leave time out and state sampling_rate",
        f"{place}, sample {first + 1}",
    )


def _uniform_step(times: NDArray[np.float64], source: str, place: str, unit: str) -> float:
    """The mean step of uniform times that begin at 0."""
    steps = np.diff(times)
    if steps.min() <= 0.0:
        refuse_same_times(times, 0.0, source, place, unit)
    usual = float(np.median(steps))
    uneven = np.abs(steps - usual) > STEP_TOLERANCE * usual
    if uneven.any():
        first = int(np.argmax(uneven))
        _refuse(
            source,
            place,
            first + 1,
            f"the step to this sample is {steps[first]:g}{unit} where the usual one is"
            f" {usual:g}{unit}",
        )
    step = float(times[-1] / steps.size)
    off = np.abs(times - step * np.arange(times.size))
    allowed = max(0.5 * step, GRID_TOLERANCE * float(times[-1]))
    if off.max() > allowed:
        first = int(np.argmax(off > allowed))
        _refuse(source, place, first, f"the time is {off[first]:g}{unit} off an even grid")
    return step


def _refuse(source: str, place: str, index: int, problem: str) -> NoReturn:
    raise InputError(
        source,
        problem,
        "bring the recording to a constant rate (of a file: uneven_time: interpolate), or leave"
        " time out and state sampling_rate",
        f"{place}, sample {index + 1}",
    )


def _spelled(unit: str) -> str:
    """A unit without brackets, final point and the date that it counts from."""
    bare = unit.strip().strip("[](){}<>").strip().rstrip(".").casefold()
    return re.sub(r"\s+since\s.*", "", bare.replace("μ", "µ"))


def _stated_unit(name: str, unit: str, source: str, place: str) -> str | None:
    """The unit that the file states for the stamps, as a key of `TIME_UNITS`."""
    own, in_name = _spelled(unit), _unit_in_name(name)
    stated = [text for text in ("" if own == "-" else own, in_name) if text]
    for text in stated:
        if text not in _UNIT_OF:
            raise InputError(
                source,
                f'"{text}" is no known unit of time',
                f"set time_unit to one of {', '.join(TIME_UNITS)}",
                place,
            )
    units = {_UNIT_OF[text] for text in stated}
    if len(units) > 1:
        raise InputError(
            source,
            f'the file states the unit "{unit}" for a channel whose name states "{in_name}"',
            "set time_unit to the right one",
            place,
        )
    return units.pop() if units else None


def _words(name: str) -> list[str]:
    return re.split(r"[\s_\-./,:;|\[\](){}<>]+", _CAMEL_CASE.sub(" ", name))


def _unit_in_name(name: str) -> str:
    """What stands for a unit in the name of a time channel, known or not; empty if nothing does.

    That is a text in brackets at the end; else a last or first word that is a known unit, as in
    "time_ms_1" and "Seconds elapsed"; else a last word of letters that follows a word for time,
    as in "time_ticks", and is none of the usual ones there.
    """
    bracketed = _BRACKET.search(name)
    if bracketed:
        return _spelled(bracketed.group(1))
    words = [word for word in map(_spelled, _words(name)) if word]
    while len(words) > 1 and (words[-1] in _OTHER_WORDS or words[-1].isdigit()):
        words.pop()
    if not words:
        return ""
    first, last = words[0], words[-1]
    joined = _JOINED.fullmatch(last)
    if joined:
        return joined.group(1)
    for word in (last, first):
        # A single letter may be a name of its own.
        if word in _UNIT_OF and (len(words) > 1 or word == "s" or len(word) > 1):
            return word
    follows = any(word in _TIME_WORDS for word in words[:-1])
    if follows and last.isalpha() and last not in _TIME_WORDS | _OTHER_WORDS:
        return last
    return ""


def _scale(
    ticks: NDArray,
    step: float,
    stated_rate: float | None,
    tolerance: float,
    source: str,
    place: str,
) -> float:
    """Seconds in the unit of stamps for which the file states none."""
    if not np.array_equal(ticks, np.round(ticks)):
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
    raise InputError(
        source,
        f"the time stamps are whole numbers {step:g} apart, which may be seconds, milliseconds or"
        " microseconds",
        choice,
        place,
    )
