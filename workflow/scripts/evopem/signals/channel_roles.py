"""Which channel of a file is the input, which the output, and which the time."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from evopem.errors import InputError
from evopem.signals.causality import SIGNIFICANCE, CausalityTest, causality_test
from evopem.signals.inspection import SignalColumn, inspect_file
from evopem.signals.measured_files import read_channels
from evopem.signals.readers.channels import Reference

INPUT_NAMES = frozenset(
    (
        *("u", "in", "input", "excitation", "command", "drive", "stimulus"),
        *("force", "torque", "voltage", "valve", "heater"),
    )
)
"""Words that name an input."""
OUTPUT_NAMES = frozenset(
    (
        *("y", "out", "output", "response", "acceleration", "acc", "accel", "velocity", "speed"),
        *("position", "displacement", "angle", "temperature", "level"),
    )
)
"""Words that name an output."""


@dataclass(frozen=True)
class ChannelRoles:
    """The channels of a file by what they are, and how that was told.

    Attributes
    ----------
    input, output, time : int or str
    test : CausalityTest, optional
        From the input to the output; None where the names tell.
    """

    input: Reference
    output: Reference
    time: Reference
    test: CausalityTest | None = None

    @property
    def sentence(self) -> str:
        """How input and output were told apart."""
        pair = f"“{self.input}” is the input and “{self.output}” the output"
        if self.test is None:
            return f"{pair} by their names."
        return (
            f"{pair}: the past of the first improves predictions of the second"
            f" (p = {self.test.forward:.2g}, {self.test.lags} lags), and not the reverse"
            f" (p = {self.test.backward:.2g})."
        )


def roles_of(path: str | Path) -> ChannelRoles | None:
    """Tell the channels of a file with a time and two signals; None where there is no time.

    By the words of their names, else by a test of causality.

    Raises
    ------
    InputError
        When there are not two other channels, or they cannot be told apart.
    """
    contents = inspect_file(path)
    if contents.time is None:
        return None
    source, time = str(path), contents.time.reference
    if len(contents.signals) != 2:
        names = ", ".join(repr(each.reference) for each in contents.signals) or "none"
        raise InputError(
            source,
            f"beside the time there are {len(contents.signals)} channels that may be input or"
            f" output ({names}), where two can be told apart",
            "name input and output",
        )
    first, second = contents.signals
    inputs, outputs = (named(contents.signals, words) for words in (INPUT_NAMES, OUTPUT_NAMES))
    if len(inputs) == 1 and len(outputs) == 1 and inputs != outputs:
        return ChannelRoles(inputs[0].reference, outputs[0].reference, time)
    channels = read_channels(path, [first.reference, second.reference])
    if channels[0].values.size != channels[1].values.size:
        raise InputError(source, "its two channels have different lengths", "name input and output")
    test = causality_test(*(each.values.astype(float) for each in channels))
    if test.direction == 0:
        raise InputError(
            source,
            f"{first.reference!r} and {second.reference!r} cannot be told apart as input and"
            " output: their names do not say it, and the past of "
            + _undecided(test)
            + f" at {100 * SIGNIFICANCE:g} %",
            "name input and output",
        )
    if test.direction > 0:
        return ChannelRoles(first.reference, second.reference, time, test)
    turned = CausalityTest(test.backward, test.forward, test.lags)
    return ChannelRoles(second.reference, first.reference, time, turned)


def named(signals: Iterable[SignalColumn], words: frozenset[str]) -> list[SignalColumn]:
    """The channels whose names hold one of some words."""
    found = []
    for signal in signals:
        parts = re.split(r"[^a-z]+", str(signal.reference).casefold())
        if words.intersection(parts):
            found.append(signal)
    return found


def _undecided(test: CausalityTest) -> str:
    if test.forward < SIGNIFICANCE:
        return "each improves predictions of the other"
    return "neither improves predictions of the other"
