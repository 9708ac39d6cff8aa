"""Names of channels with a ``*``, which stand for all channels that match."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path

from evopem.config.channels import ChannelSettings, Reference, is_pattern
from evopem.errors import InputError
from evopem.signals.measured_files import channel_names
from evopem.signals.readers.channels import listing


def expanded(
    path: str | Path, channels: ChannelSettings
) -> tuple[tuple[Reference, ...], tuple[Reference, ...]]:
    """Inputs and outputs with every pattern replaced by the numbers of its channels.

    A pattern stands for all channels whose names it matches and that no other entry names.  The
    very name of a channel is no pattern, whatever it holds.
    """
    written = {"input": channels.inputs, "output": channels.outputs}
    everything = [*channels.inputs, *channels.outputs]
    everything += [] if channels.time is None else [channels.time]
    if not any(map(is_pattern, everything)):
        return channels.inputs, channels.outputs
    names = channel_names(path)
    known = {*names, *(name.rpartition("/")[2] for name in names)}
    literal = [each for each in everything if not is_pattern(each) or each in known]
    named = {each for each in literal if isinstance(each, int)}
    named |= {number for number, name in enumerate(names, 1) if name in literal}
    taken: dict[int, str] = {}
    chosen: dict[str, list[Reference]] = {"input": [], "output": []}
    for role, references in written.items():
        for reference in references:
            if reference in literal:
                chosen[role].append(reference)
                continue
            # A channel of a group is found by its own name as well, as one without a pattern is.
            matching = _matching(str(reference), names, named) or _matching(
                str(reference), [name.rpartition("/")[2] for name in names], named
            )
            if not matching:
                raise InputError(
                    str(path),
                    f'no channel matches "{reference}"',
                    f"choose among {listing(names)}" if any(names) else "give numbers",
                    role,
                )
            for number in matching:
                if number in taken:
                    raise InputError(
                        str(path),
                        f'the channel "{names[number - 1]}" matches "{reference}" and'
                        f" {taken[number]}",
                        "give patterns that share no channel",
                        role,
                    )
                taken[number] = f'"{reference}" of {role}'
            chosen[role] += matching
    return tuple(chosen["input"]), tuple(chosen["output"])


def _matching(pattern: str, names: Sequence[str], named: Collection[int]) -> list[int]:
    """Numbers of the channels whose names fit a pattern, without those that are named."""
    fits = [number for number, name in enumerate(names, 1) if _matches(pattern, name)]
    return [number for number in fits if number not in named]


def _matches(pattern: str, name: str) -> bool:
    """Whether a name fits a pattern, in which only ``*`` has a meaning."""
    return re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), name, re.DOTALL) is not None
