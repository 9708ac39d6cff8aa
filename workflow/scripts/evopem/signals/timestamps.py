"""A sampling rate from time stamps, and the check that they are uniform."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError

STEP_TOLERANCE = 0.1
"""A step may differ by this share of the median step."""
GRID_TOLERANCE = 1e-3
"""A stamp may lie off the even grid by this share of the record, or by half a step."""
RATE_TOLERANCE = 1e-3
"""A stated rate and the stamps' own may differ by this share."""

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNIT_IN_NAME = re.compile(r"(?:^|[\s_\[(/,.-])(s|sec|seconds|ms|us|µs|μs|ns)[\])]?$", re.I)
_UNIT_NAMES = {"sec": "s", "seconds": "s", "µs": "us", "μs": "us"}
# Seconds since 1970 for the years 2001 to 2286, in each unit.
_EPOCHS = {unit: (1e9 / scale, 1e10 / scale) for unit, scale in _SECONDS.items()}


def sampling_rate_of(
    stamps: NDArray,
    source: str,
    name: str,
    unit: str = "",
    stated_rate: float | None = None,
) -> float:
    """Sampling rate (Hz) of uniform time stamps.

    Numbers with a fraction are seconds unless a unit is stated, as `unit` or at the end of
    the name ("time_ms", "t [µs]"). Whole numbers without a unit are taken as milliseconds
    and so on only where a stated rate or their size (time since 1970) decides it.

    The stamps must increase; each step must be within 10 % of the median step, and each
    stamp within half a step, or 0.1 % of the record, of the even grid from the first stamp
    to the last.

    Parameters
    ----------
    stamps : ndarray, shape (N,)
        Numbers or dates (datetime64).
    source, name : str
        File and channel that an error names.
    unit : str
        "s", "ms", "us" ("µs") or "ns", when the file states one.
    stated_rate : float, optional
        Rate (Hz) stated elsewhere. When the stamps agree with it, it is returned.

    Raises
    ------
    InputError
        When the stamps are too few, not finite, not increasing, not uniform (the first bad
        sample is named, counted from 1), of an undecided unit, or contradict the stated rate.
    """
    place = f'time "{name}"' if name else "time"
    if stamps.size < 2:
        raise InputError(source, "there are fewer than two time stamps", "give a longer recording")
    if stamps.dtype.kind == "M":
        if np.isnat(stamps).any():
            first = int(np.argmax(np.isnat(stamps)))
            _refuse(source, place, first, "the time stamp is missing")
        ticks = stamps.astype("datetime64[ns]").astype(np.int64)
        unit = "ns"
    elif stamps.dtype.kind in "iuf":
        # Wide types first: differences of unsigned or short integers would wrap round.
        ticks = stamps.astype(np.float64 if stamps.dtype.kind == "f" else np.int64)
        if not np.isfinite(ticks).all():
            first = int(np.argmin(np.isfinite(ticks)))
            _refuse(source, place, first, f"the time stamp is {ticks[first]}")
    else:
        raise InputError(source, "the channel holds no times", "choose another channel", place)
    # From the first stamp on, so that dates in nanoseconds keep all their digits as floats.
    since_start = (ticks - ticks[0]).astype(np.float64)
    step = _uniform_step(since_start, source, place)
    scale = _scale(ticks, step, name, unit, stated_rate, source, place)
    rate = float(f"{1.0 / (step * scale):.9g}")
    if stated_rate is None:
        return rate
    if abs(rate / stated_rate - 1.0) > RATE_TOLERANCE:
        raise InputError(
            source,
            f"the time stamps give {rate:g} Hz and the stated sampling rate is {stated_rate:g} Hz",
            "correct one of them or leave one out",
            place,
        )
    return float(stated_rate)


def _uniform_step(times: NDArray[np.float64], source: str, place: str) -> float:
    """The mean step of uniform times that begin at 0."""
    steps = np.diff(times)
    if steps.min() <= 0.0:
        _refuse(source, place, int(np.argmax(steps <= 0.0)) + 1, "the time does not increase")
    usual = float(np.median(steps))
    uneven = np.abs(steps - usual) > STEP_TOLERANCE * usual
    if uneven.any():
        first = int(np.argmax(uneven))
        _refuse(
            source,
            place,
            first + 1,
            f"the step to this sample is {steps[first]:g} where the usual one is {usual:g}",
        )
    step = float(times[-1] / steps.size)
    off = np.abs(times - step * np.arange(times.size))
    allowed = max(0.5 * step, GRID_TOLERANCE * float(times[-1]))
    if off.max() > allowed:
        first = int(np.argmax(off > allowed))
        _refuse(source, place, first, f"the time is {off[first]:g} off an even grid")
    return step


def _refuse(source: str, place: str, index: int, problem: str) -> None:
    raise InputError(
        source,
        problem,
        "bring the recording to a constant rate, or leave time out and state sampling_rate",
        f"{place}, sample {index + 1}",
    )


def _scale(
    ticks: NDArray,
    step: float,
    name: str,
    unit: str,
    stated_rate: float | None,
    source: str,
    place: str,
) -> float:
    """Seconds in one unit of the stamps."""
    found = _UNIT_IN_NAME.search(name.strip())
    spelled = (unit or (found.group(1) if found else "")).strip().lower()
    spelled = _UNIT_NAMES.get(spelled, spelled)
    if spelled in _SECONDS:
        return _SECONDS[spelled]
    if not np.array_equal(ticks, np.round(ticks)):
        return 1.0
    if stated_rate is not None:
        for scale in _SECONDS.values():
            if abs(1.0 / (step * scale * stated_rate) - 1.0) <= RATE_TOLERANCE:
                return scale
        return 1.0
    for candidate, (low, high) in _EPOCHS.items():
        if low <= float(ticks[0]) < high:
            return _SECONDS[candidate]
    raise InputError(
        source,
        f"the time stamps are whole numbers {step:g} apart, which may be seconds, milliseconds or"
        " microseconds",
        f"state sampling_rate as well (for milliseconds {1e3 / step:g}), or name the channel with"
        " its unit, as in time_ms",
        place,
    )
