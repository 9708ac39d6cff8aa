"""LabVIEW's TDMS files, read by nptdms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evopem.errors import InputError
from evopem.signals.readers.channels import (
    Channel,
    Reference,
    find_channel,
    library,
    refuse_unreadable,
)
from evopem.signals.timestamps import seconds_of


def read(path: Path, references: Sequence[Reference]) -> list[Channel]:
    """Read channels by ``group/channel``, by the channel's name where it is unique, or by number.

    The sampling rate comes from the waveform property ``wf_increment`` (in the unit of
    ``wf_xunit_string``), the unit from ``unit_string``, the start from ``wf_start_time`` and
    ``wf_start_offset``.
    """
    stored = _stored(path)
    full_names = _full_names(stored)
    short_names = [channel.name for channel in stored]
    channels = []
    for reference in references:
        short = reference in short_names and reference not in full_names
        index = find_channel(path, reference, short_names if short else full_names, "channel")
        channel = stored[index]
        rate, problem = _sampling_rate(channel.properties)
        channels.append(
            Channel(
                name=channel.name,
                values=np.asarray(channel[:]),
                unit=str(channel.properties.get("unit_string", "")),
                sampling_rate=rate,
                rate_problem=problem,
                start=_start(channel.properties),
            )
        )
    return channels


def names(path: Path) -> list[str]:
    """``group/channel`` of all channels in the order of their numbers."""
    return _full_names(_stored(path))


def _stored(path: Path) -> list[Any]:
    """All channels of a file."""
    nptdms = library("nptdms", path)
    try:
        content = nptdms.TdmsFile.read(path)
        stored = [channel for group in content.groups() for channel in group.channels()]
        incomplete = content.file_status.incomplete_final_segment
    except Exception:
        # nptdms meets damage with struct.error, ValueError, KeyError, OverflowError …
        refuse_unreadable(path, "TDMS file")
    if incomplete:
        raise InputError(str(path), "the file breaks off", "copy or export it again")
    return stored


def _full_names(stored: Sequence[Any]) -> list[str]:
    return [f"{channel.group_name}/{channel.name}" for channel in stored]


def _sampling_rate(properties: Mapping[str, Any]) -> tuple[float | None, str]:
    """The rate (Hz) of a channel, or what is wrong with the property that states it."""
    increment = properties.get("wf_increment")
    if increment is None:
        return None, ""
    unit = str(properties.get("wf_xunit_string", ""))
    scale = seconds_of(unit) if unit.strip() else 1.0
    if scale is None:
        return None, f'its wf_increment is in the unit "{unit}", which is no known unit of time'
    if not isinstance(increment, int | float | np.number) or isinstance(increment, bool):
        return None, f"its wf_increment is {increment}, not a number of seconds"
    step = float(increment) * scale
    # LabVIEW writes 0 for a channel that is no waveform.
    if step == 0.0:
        return None, ""
    if not (np.isfinite(step) and step > 0.0 and np.isfinite(1.0 / step)):
        return None, f"its wf_increment is {step:g} s"
    return 1.0 / step, ""


def _start(properties: Mapping[str, Any]) -> float | None:
    """Time (s) of the first sample since 1970, or since 0 where no date is stated."""
    offset = properties.get("wf_start_offset", 0.0)
    begin = properties.get("wf_start_time")
    try:
        seconds = float(offset)
        if begin is not None:
            # np.datetime64 in microseconds
            seconds += float(np.datetime64(begin, "us").astype(np.int64)) * 1e-6
    except (TypeError, ValueError, OverflowError):
        return None
    return seconds if begin is not None or "wf_start_offset" in properties else None
