"""LabVIEW's TDMS files, read by nptdms."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from evopem.errors import InputError
from evopem.signals.readers.open_file import Channel, Contents, Properties, library, refusing_damage
from evopem.signals.time_units import seconds_of


@contextmanager
def opened(path: Path) -> Iterator[Contents]:
    """The channels of a file, ``group/channel``, also known without the group.

    Rate, unit and start come from the properties wf_increment, unit_string and wf_start_time.
    """
    nptdms = library("nptdms", path)
    with refusing_damage(path, "TDMS file"):
        content = nptdms.TdmsFile.read(path)
        stored = [channel for group in content.groups() for channel in group.channels()]
        incomplete = content.file_status.incomplete_final_segment
    if incomplete:
        raise InputError(str(path), "the file breaks off", "copy or export it again")

    def load(index: int) -> Channel:
        channel, properties = stored[index], stored[index].properties
        unit = str(properties.get("unit_string", ""))
        rate = _sampling_rate(properties)
        return Channel(channel.name, np.asarray(channel[:]), unit, *rate, _start(properties))

    names = [(f"{group.group_name}/{group.name}", group.name) for group in stored]
    yield Contents(path, "channel", names, load)


def _sampling_rate(properties: Properties) -> tuple[float | None, str]:
    """The rate (Hz) of a channel, or what is wrong with the property that states it."""
    increment = properties.get("wf_increment", 0.0)
    unit = str(properties.get("wf_xunit_string", ""))
    scale = seconds_of(unit) if unit.strip() else 1.0
    if scale is None:
        return None, f'its wf_increment is in the unit "{unit}", which is no known unit of time'
    if not isinstance(increment, int | float | np.number) or isinstance(increment, bool):
        return None, f"its wf_increment is {increment}, not a number of seconds"
    step = float(increment) * scale
    if step == 0.0:  # LabVIEW writes it for a channel that is no waveform
        return None, ""
    if np.isfinite(step) and step > 0.0 and np.isfinite(1.0 / step):
        return 1.0 / step, ""
    return None, f"its wf_increment is {step:g} s"


def _start(properties: Properties) -> float | None:
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
