"""The constant rate of channels that were sampled together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.config.channels import ChannelSettings
from evopem.errors import InputError
from evopem.signals.even_grid import Unevenness, coarseness, even_grid
from evopem.signals.measured_files import channel_names
from evopem.signals.readers.channels import Channel
from evopem.signals.timestamps import names_time, sampling_rate_of


class Sampled(NamedTuple):
    """Signals at a constant rate."""

    signals: dict[str, NDArray[np.float64]]  # (N,)
    rate: float  # Hz
    # of the time stamps, where the signals were brought to an even grid or the clock is coarse
    unevenness: Unevenness | None


def sampled(
    signals: dict[str, NDArray[np.float64]],
    channels: dict[str, Channel],
    stated: ChannelSettings,
    source: str,
) -> Sampled:
    """The signals at the rate that is stated, else that of the time stamps, else the file's own.

    ``signals`` are (N,) arrays by role, ``channels`` what the file holds, with the time stamps as
    ``time``.
    """
    if stated.uneven_time == "refuse":
        rate = _sampling_rate(channels, stated, source)
        time = channels.get("time")
        found = None if time is None else coarseness(time.values, source, time.name)
        return Sampled(signals, rate, found)
    if "time" not in channels:
        raise InputError(
            source,
            "uneven_time is stated without a time channel",
            f"state time{_named_times(source)}, or remove uneven_time",
        )
    time = channels["time"]
    grid = even_grid(time.values, source, time.name)
    rate = _sampling_rate(channels, stated, source, grid.step)
    on_grid = {role: grid.interpolated(each) for role, each in signals.items()}
    return Sampled(on_grid, rate, grid.unevenness)


def _sampling_rate(
    channels: dict[str, Channel], stated: ChannelSettings, source: str, step: float | None = None
) -> float:
    """The rate that is stated, else that of the time stamps, else the file's own.

    That of the time stamps follows from their mean step where they are not uniform.
    """
    signals = [channel for role, channel in channels.items() if role != "time"]
    in_file = list(dict.fromkeys(channel.sampling_rate for channel in signals))
    if len(in_file) > 1 and stated.sampling_rate is None:
        rates = " and ".join("none" if one is None else f"{one:g} Hz" for one in in_file)
        raise InputError(
            source,
            f"the file states different sampling rates for input and output ({rates})",
            "choose two channels that were sampled together",
        )
    own = in_file[0] if len(in_file) == 1 else None
    if "time" in channels:
        time = channels["time"]
        if time.values.size != signals[0].values.size:
            raise InputError(
                source,
                f"there are {time.values.size} time stamps and {signals[0].values.size} samples",
                "choose the time channel of these signals",
                f'time "{time.name}"',
            )
        known = own if stated.sampling_rate is None else stated.sampling_rate
        stamps = time.values, source, time.name, time.unit
        return sampling_rate_of(*stamps, known, stated.time_unit, step)
    if stated.time_unit is not None:
        raise InputError(
            source, "time_unit is stated without a time channel", "remove it or state time"
        )
    if stated.sampling_rate is not None:
        return float(stated.sampling_rate)
    if own is not None:
        return own
    problem = next((one.rate_problem for one in signals if one.rate_problem), "")
    raise InputError(
        source,
        f"the sampling rate is not known, since {problem or 'the file states none'}",
        f"give sampling_rate in Hz or the name of a time channel{_named_times(source)}",
    )


def _named_times(path: str) -> str:
    """The first channel whose name says that it holds times, in words; empty where none does.

    LabVIEW's `X_Value` is mostly a time, which its name does not say.
    """
    names = channel_names(path)
    named = [name for name in names if names_time(name)] or [n for n in names if n == "X_Value"]
    return f', such as "{named[0]}"' if named else ""
