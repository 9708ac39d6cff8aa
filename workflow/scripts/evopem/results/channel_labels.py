"""What inputs and outputs are called, with their units, as recorded and as prepared."""

import re
from dataclasses import dataclass
from typing import Self

from evopem.signals.prepared_data import Transforms


def with_unit(name: str, unit: str) -> str:
    """Label of an axis: name and unit, with unprintable characters replaced."""
    shown = f"{name} ({unit})" if unit else name
    return "".join(character if character.isprintable() else "\ufffd" for character in shown)


@dataclass(frozen=True)
class Channel:
    """An input or output."""

    name: str  # as recorded
    unit: str
    prepared: str  # after the transforms
    prepared_unit: str

    @classmethod
    def of_input(cls, name: str, unit: str, transforms: Transforms) -> Self:
        """An input as recorded and as prepared."""
        return cls(name, unit, _differenced(transforms.difference_input, name, transforms), unit)

    @classmethod
    def of_output(cls, name: str, unit: str, transforms: Transforms) -> Self:
        """An output alike; a power transform leaves it without a unit."""
        is_linear = transforms.box_cox is None
        shown = name if is_linear else f"Box-Cox transformed {name}"
        prepared = _differenced(transforms.difference, shown, transforms)
        return cls(name, unit, prepared, unit if is_linear else "")

    @property
    def label(self) -> str:
        """Name with unit after the transforms."""
        return with_unit(self.prepared, self.prepared_unit)


Pair = tuple[Channel, Channel | None]  # an output with an input, or alone


def gain_unit(output: Channel, source: Channel | None) -> str:
    """Unit of a gain of prepared signals, empty where either unit is not stated."""
    numerator, denominator = output.prepared_unit, source.prepared_unit if source else ""
    if not numerator or not denominator:
        return ""
    above = f"({numerator})" if " " in numerator else numerator
    below = f"({denominator})" if re.search(r"[ /·]", denominator) else denominator
    return f"{above}/{below}"


def _differenced(count: int, name: str, transforms: Transforms) -> str:
    """What the difference of a channel is called: "second difference of torque"."""
    if not count:
        return name
    if transforms.difference_pole:
        return f"high-pass filtered {name}"
    ordinal = {1: "first", 2: "second", 3: "third"}.get(count, f"{count}th")
    return f"{ordinal} difference of {name}"
