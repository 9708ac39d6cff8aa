"""LabVIEW's TDMS files, read by nptdms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from evopem.errors import InputError
from evopem.signals.readers.channels import (
    Channel,
    Reference,
    find_channel,
    library,
    refuse_unreadable,
)


def read(path: Path, references: Sequence[Reference]) -> list[Channel]:
    """Read channels by ``group/channel``, by the channel's name where it is unique, or by number.

    The sampling rate is that of the waveform property ``wf_increment``, the unit that of
    ``unit_string``.

    Raises
    ------
    InputError
        When the file is damaged, breaks off or is no TDMS, nptdms is missing, or there is
        no such channel.
    """
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
    full_names = [f"{channel.group_name}/{channel.name}" for channel in stored]
    short_names = [channel.name for channel in stored]
    channels = []
    for reference in references:
        short = reference in short_names and reference not in full_names
        index = find_channel(path, reference, short_names if short else full_names, "channel")
        channel = stored[index]
        increment = channel.properties.get("wf_increment")
        channels.append(
            Channel(
                name=channel.name,
                values=np.asarray(channel[:]),
                unit=str(channel.properties.get("unit_string", "")),
                sampling_rate=1.0 / float(increment) if increment else None,
            )
        )
    return channels
