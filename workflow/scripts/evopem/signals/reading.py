"""Read a recording from a measured file of any known format."""

import itertools
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from evopem.arrays import Array
from evopem.config.channels import ChannelSettings, Units, is_pattern, of_each
from evopem.errors import InputError
from evopem.files.checksums import sha256_of_file
from evopem.signals.faulty_samples import without_missing
from evopem.signals.inspection import time_from_file
from evopem.signals.measured_files import channel_names, format_of, local_path, read_channels
from evopem.signals.readers.open_file import Channel, Reference, listing
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import check_recording
from evopem.signals.recording_info import FileOrigin
from evopem.signals.time_units import names_time
from evopem.signals.timestamps import Timing, is_time, timing
from evopem.signals.transforms import resample_recording


def read_measured(
    name: str | Path, channels: ChannelSettings, folder: str | Path = ""
) -> tuple[Recording, FileOrigin]:
    """Read the input and output channels of a measured file, by the settings of a data set.

    ``name`` is what the settings call the file, relative to ``folder``. The channel of time stamps
    is taken from the file where neither it nor a rate is stated. `InputError` where the file, its
    channels, their timing or their units cannot be used.
    """
    path = Path(folder) / name
    source = str(path)
    inputs, outputs = _expanded(path, channels)
    time = None
    stated = (channels.sampling_rate, channels.time, channels.header_lines, channels.decimal_mark)
    if all(value is None for value in stated):
        time = time_from_file(path, [*inputs, *outputs])
        channels = replace(channels, time=time)
    references = {
        kind if len(listed) == 1 else f"{kind} {number}": words
        for kind, listed in (("input", inputs), ("output", outputs))
        for number, words in enumerate(listed, 1)
    }
    roles = list(references)
    for first, second in itertools.combinations(roles, 2):
        if references[first] == references[second]:
            problem = f"channel {references[first]!r} is named as the {first} and as the {second}"
            raise InputError(source, problem, "choose two different channels")
    if channels.time is not None:
        references["time"] = channels.time
    read = read_channels(
        path, list(references.values()), channels.header_lines, channels.decimal_mark
    )
    if channels.sampling_rate is None and len({c.sampling_rate for c in read[: len(roles)]}) > 1:
        read = _at_lowest_rate(read[: len(roles)], channels, source)
        channels = replace(channels, uneven_time="refuse")
    columns = dict(zip(references, read, strict=True))
    values = {role: _signal(columns[role], role, source) for role in roles}
    first = roles[0]
    for role, value in values.items():
        if value.size != values[first].size:
            problem = f"the {first} has {values[first].size} samples and the {role} {value.size}"
            remedy = f"choose {'two ' * (len(values) == 2)}channels that were sampled together"
            raise InputError(source, problem, remedy)
    for role, second in itertools.combinations(columns, 2):
        pair = columns[role].values, columns[second].values
        floats = all(values.dtype.kind == "f" for values in pair)
        if np.array_equal(*pair, equal_nan=floats):
            problem = (
                f"the {role} ({references[role]!r}) and the {second}"
                f" ({references[second]!r}) hold the same values"
            )
            raise InputError(source, problem, "choose different channels")
    timed = _timing(columns, channels, source)
    read = read[: len(roles)]  # without the time
    starts = [recording.start for recording in read]
    for start in starts:
        late = 0.0 if start is None or starts[0] is None else start - starts[0]
        # A date in seconds since 1970 has a resolution of less than a microsecond as a float.
        if abs(late) > max(0.5 / timed.rate, 1e-6):
            remedy = "choose two channels that were sampled together"
            problem = f"the output begins {abs(late):g} s {'after' if late > 0.0 else 'before'}"
            raise InputError(source, f"{problem} the input", remedy)
    names = _names(read, roles)
    signals = np.column_stack([timed.on_grid(values[role]) for role in roles])
    count = len(inputs)
    whole = Recording(
        inputs=signals[:, :count],
        outputs=signals[:, count:],
        sampling_rate=timed.rate,
        input_names=names[:count],
        output_names=names[count:],
        input_units=_units(channels.input_unit, read[:count], names[:count], source, "input"),
        output_units=_units(channels.output_unit, read[count:], names[count:], source, "output"),
    )
    recording, filled = without_missing(whole, source)
    check_recording(recording, source, measured=True)
    for place, signal in recording.longest.signals.items():
        if is_time(signal, timed.rate):
            problem = "the channel increases by the sampling period in every sample, as a time does"
            raise InputError(source, problem, "choose another channel", place)
    local = local_path(path)
    return recording, FileOrigin(
        path=str(Path(name)),
        sha256=sha256_of_file(local),
        bytes=local.stat().st_size,
        format=format_of(path),
        inputs=channels.inputs,
        outputs=channels.outputs,
        samples=recording.samples,
        segments=len(recording.segments),
        left_out=whole.samples - recording.samples,
        filled=filled,
        time_from_file=time,
        unevenness=timed.unevenness,
    )


def _signal(channel: Channel, role: str, source: str) -> Array:
    """The samples of an input or output channel as real numbers."""
    kind = channel.values.dtype.kind
    if kind not in "fiub":
        held = {"c": "complex numbers", "M": "dates"}.get(kind, "text or objects")
        problem = f"the channel holds {held}, not real numbers"
        place = f'{role} "{channel.name}"' if channel.name else role
        raise InputError(source, problem, "choose another channel", place)
    return channel.values.astype(np.float64)


def _timing(channels: Mapping[str, Channel], stated: ChannelSettings, source: str) -> Timing:
    """The rate that is stated, else that of the time stamps, else the file's own."""
    signals = [channel for role, channel in channels.items() if role != "time"]
    in_file = list(dict.fromkeys(channel.sampling_rate for channel in signals))
    clock = in_file[0] if len(in_file) == 1 else None
    known = clock if stated.sampling_rate is None else float(stated.sampling_rate)
    if known is not None and not (np.isfinite(known) and known > 0.0):
        raise InputError(source, f"{known} Hz is no sampling rate", "give a positive number of Hz")
    if "time" in channels:
        time, samples = channels["time"], signals[0].values.size
        if time.values.size != samples:
            problem = f"there are {time.values.size} time stamps and {samples} samples"
            remedy = "choose the time channel of these signals"
            raise InputError(source, problem, remedy, f'time "{time.name}"')
        stamps, interpolate = time.values, stated.uneven_time == "interpolate"
        return timing(stamps, source, time.name, time.unit, known, stated.time_unit, interpolate)
    for key, is_stated in (
        ("uneven_time", stated.uneven_time != "refuse"),
        ("time_unit", stated.time_unit is not None),
    ):
        if is_stated:
            remedy = f"state time{_named_times(source)}, or remove {key}"
            raise InputError(source, f"{key} is stated without a time channel", remedy)
    if known is None:
        problem = next((s.rate_problem for s in signals if s.rate_problem), "")
        problem = f"the sampling rate is not known, since {problem or 'the file states none'}"
        remedy = f"give sampling_rate in Hz or the name of a time channel{_named_times(source)}"
        raise InputError(source, problem, remedy)
    return Timing(known)


def _named_times(path: str) -> str:
    """The first channel whose name says that it holds times, in words; empty where none does.
    LabVIEW's `X_Value` is mostly a time, which its name does not say."""
    names = channel_names(path)
    named = [name for name in names if names_time(name)] or [n for n in names if n == "X_Value"]
    return f', such as "{named[0]}"' if named else ""


def _at_lowest_rate(read: Sequence[Channel], stated: ChannelSettings, source: str) -> list[Channel]:
    """Channels of different rates at the lowest of them, over the time that all of them cover.
    Faster ones pass the filter of :func:`resample_signal`, which has no delay. `InputError` where
    nothing asks for it, or where they have no time in common."""
    rates = {channel.sampling_rate: None for channel in read}
    if None in rates or stated.time is not None or stated.uneven_time != "interpolate":
        words = " and ".join("none" if rate is None else f"{rate:g} Hz" for rate in rates)
        problem = f"the file states different sampling rates for input and output ({words})"
        remedy = "choose two channels that were sampled together"
        if None not in rates and stated.time is None:
            remedy += ", or state uneven_time: interpolate for the lowest rate"
        raise InputError(source, problem, remedy)
    ordered, starts = sorted(filter(None, rates)), [channel.start or 0.0 for channel in read]
    if any(channel.start is None for channel in read):
        starts = [0.0] * len(read)
    # They begin at the first sample of the slowest one that all have, to half a sample of each.
    lowest = ordered[0]
    slow = starts[[channel.sampling_rate for channel in read].index(lowest)]
    begun = slow + np.ceil((max(starts) - slow - 0.5 / ordered[-1]) * lowest) / lowest
    resampled = []
    for number, (channel, start) in enumerate(zip(read, starts, strict=True), 1):
        rate = channel.sampling_rate or lowest
        early = max(round((begun - start) * rate), 0)
        values = _signal(channel, f"channel {number}", source)[early:]
        if not values.size:
            remedy = "choose channels that were sampled together"
            raise InputError(source, "the channels have no time in common", remedy)
        if rate != lowest:
            alone = Recording(np.empty((values.size, 0)), values, rate)
            values = resample_recording(alone, lowest, f"{source}, {channel.name}").output
        resampled.append(replace(channel, values=values, sampling_rate=lowest, start=None))
    samples = min(channel.values.size for channel in resampled)
    return [replace(channel, values=channel.values[:samples]) for channel in resampled]


def _names(given: Sequence[Channel], roles: Sequence[str]) -> tuple[str, ...]:
    """A name of its own for each channel; one without a name is called by its role."""
    names: list[str] = []
    for channel, role in zip(given, roles, strict=True):
        chosen = channel.name.strip() or role
        names.append(f"{chosen} ({role})" if chosen in names else chosen)
    return tuple(names)


def _units(
    given: Units | None, channels: Sequence[Channel], names: Sequence[str], source: str, role: str
) -> tuple[str, ...]:
    """The unit of each channel: the stated one, else the file's own."""
    stated = of_each(given, names, source, f"{role}_unit", role)
    return tuple(unit or channel.unit for unit, channel in zip(stated, channels, strict=True))


def _expanded(
    path: str | Path, channels: ChannelSettings
) -> tuple[tuple[Reference, ...], tuple[Reference, ...]]:
    """Inputs and outputs with every pattern replaced by the numbers of its channels. A pattern
    stands for all channels whose names it matches and that no other entry names.  The very name of
    a channel is no pattern, whatever it holds."""
    everything = [*channels.inputs, *channels.outputs]
    everything += [] if channels.time is None else [channels.time]
    if not any(map(is_pattern, everything)):
        return channels.inputs, channels.outputs
    names = channel_names(path)
    short = [name.rpartition("/")[2] for name in names]
    literal = [r for r in everything if not is_pattern(r) or r in {*names, *short}]
    named = {reference for reference in literal if isinstance(reference, int)}
    named |= {number for number, name in enumerate(names, 1) if name in literal}
    taken: dict[int, str] = {}

    def numbers(pattern: Reference, role: str) -> list[int]:
        # A channel of a group is found by its own name as well, as one without a pattern is.
        matching = _matching(str(pattern), names, named) or _matching(str(pattern), short, named)
        if not matching:
            remedy = f"choose among {listing(names)}" if any(names) else "give numbers"
            raise InputError(str(path), f'no channel matches "{pattern}"', remedy, role)
        for number in matching:
            if number in taken:
                problem = (
                    f'the channel "{names[number - 1]}" matches "{pattern}" and {taken[number]}'
                )
                raise InputError(str(path), problem, "give patterns that share no channel", role)
            taken[number] = f'"{pattern}" of {role}'
        return matching

    def expanded(role: str, references: Sequence[Reference]) -> tuple[Reference, ...]:
        lists = [[r] if r in literal else numbers(r, role) for r in references]
        return tuple(itertools.chain.from_iterable(lists))

    return expanded("input", channels.inputs), expanded("output", channels.outputs)


def _matching(pattern: str, names: Sequence[str], named: Collection[int]) -> list[int]:
    """Numbers of the channels whose names fit a pattern, in which only ``*`` has a meaning."""
    form = re.compile(".*".join(map(re.escape, pattern.split("*"))), re.DOTALL)
    fits = [number for number, name in enumerate(names, 1) if form.fullmatch(name)]
    return [number for number in fits if number not in named]
