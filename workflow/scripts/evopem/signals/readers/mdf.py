"""Measurement Data Format of ASAM, versions 2 to 4, read by asammdf."""

import gc
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from evopem.errors import InputError
from evopem.signals.readers.open_file import Channel, Contents, library, refuse_unreadable
from evopem.signals.timestamps import timing


@contextmanager
def opened(path: Path) -> Iterator[Contents]:
    """The channels of a file, ``group/channel``, also known without the group.

    A group is called as its acquisition, or by its number from 1. The rate of a channel is that of
    its group's time stamps; samples that are marked as invalid are missing.
    """
    asammdf = library("asammdf", path, "mdf")
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)  # what is wrong is said in an error
    refused = False
    with _silent_deletions():
        try:
            with path.open("rb") as stream, asammdf.MDF(stream) as file:
                yield _contents(path, file)
        except InputError:
            raise
        except Exception:
            refused = True  # asammdf meets damage with MdfException, struct.error, KeyError …
        if refused:
            gc.collect()
    if refused:
        refuse_unreadable(path, "MDF file")


@contextmanager
def _silent_deletions() -> Iterator[None]:
    """What asammdf made of a damaged file fails once more, aloud, when it is freed: here."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        yield
    finally:
        sys.unraisablehook = hook


def _contents(path: Path, file: Any) -> Contents:
    groups = [
        (number, str(getattr(group.channel_group, "acq_name", "") or number + 1), group)
        for number, group in enumerate(file.groups)
    ]
    stored = [
        (number, index, name, str(channel.name))
        for number, name, group in groups
        for index, channel in enumerate(group.channels)
    ]

    def load(index: int) -> Channel:
        number, place, _, name = stored[index]
        signal = file.get(group=number, index=place, ignore_invalidation_bits=True)
        return _channel(path, name, signal)

    names = [(f"{group}/{name}", name) for _, _, group, name in stored]
    return Contents(path, "channel", names, load)


def _channel(path: Path, name: str, signal: Any) -> Channel:
    """A channel with the rate and start of its time stamps (s)."""
    values, stamps = np.asarray(signal.samples), np.asarray(signal.timestamps, dtype=float)
    if values.ndim != 1 or values.dtype.names:
        raise InputError(str(path), "it holds arrays, not numbers", "choose another channel", name)
    if signal.invalidation_bits is not None and np.any(signal.invalidation_bits):
        values = np.where(signal.invalidation_bits, np.nan, values.astype(float))
    unit = str(signal.unit or "")
    start = float(stamps[0]) if stamps.size else None
    try:
        rate = timing(stamps, str(path), name, "s").rate
    except InputError as uneven:
        return Channel(name, values, unit, None, f"{uneven.problem} among its times", start)
    # The shortest number that leaves each stamp within a tenth of a step, for groups of one rate.
    rounded = (float(f"{rate:.{digits}g}") for digits in range(1, 10))
    rate = next((near for near in rounded if abs(near / rate - 1.0) * values.size < 0.1), rate)
    return Channel(name, values, unit, rate, "", start)
