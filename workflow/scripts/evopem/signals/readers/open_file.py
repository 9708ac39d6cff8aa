"""What every reader gives of an open file, and the errors that readers share."""

import importlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from numpy.typing import NDArray

from evopem.errors import InputError

Reference = int | str  # a channel by its number, counted from 1, or by its name

Properties = Mapping[str, Any]  # what a file says of itself or of a channel, by name

_SYMBOL = (
    r"(?:[yzafpnuµμmcdhkMGTPEZY]|da)?(?:m|s|g|A|K|mol|cd|Hz|N|Pa|J|W|C|V|F|Ω|Ohm|ohm|S|Wb|T|H|lm|lx"
    r"|rad|sr|bar|eV|L|l|Nm|Wh|Ah|Vs|Ns|S/s)|°C?|°F|deg[CF]?|degrees?|rpm|RPM|rps|rev|U|%|dB|in|ft"
    r"|lbf?|psi|min|h|hr|d|pu|p\.u\.|cnt|counts?|digits?|g's|G|1|[Vv]olts?|[Aa]mps?|[Aa]mperes?"
    r"|[Ss]ec(?:onds?)?|[Mm]illiseconds?|m?sec|usec|[Nn]ewtons?|[Mm]et(?:er|re)s?|[Hh]ertz"
)
_POWER = r"(?:\^?[+-]?\d+|\^\([+-]?\d+\)|\*\*-?\d+|[⁺⁻]?[¹²³⁴])?"
UNIT = re.compile(rf"(?:{_SYMBOL}){_POWER}(?:[ ·⋅*/.-](?:{_SYMBOL}){_POWER})*")
_HEADING = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))\s*")

LONGEST_LIST = 20  # an error lists at most this many channel names; a file may hold thousands


@dataclass(frozen=True)
class Channel:
    """One column or channel, as its file holds it."""

    name: str  # what the file calls it; empty when the file has no names
    values: NDArray[Any]  # (N,) numbers, or dates (datetime64)
    unit: str = ""  # as the file states it; empty when it does not
    sampling_rate: float | None = None  # Hz, when the file states one for this channel
    rate_problem: str = ""  # why a rate that the file states is not used, in a clause
    start: float | None = None  # time (s) of the first sample, when the file states one


@dataclass(frozen=True)
class Contents:
    """The channels of an open file, each known by its number from 1 and by its names."""

    path: Path
    kind: str  # what the format calls a channel: "column", "variable", …
    names: Sequence[tuple[str, ...]]  # of each channel, the listed one first; empty without one
    load: Callable[[int], Channel]  # by its index, from 0
    refusals: Mapping[str, InputError] = field(default_factory=dict)  # of names of no channel

    @property
    def listed(self) -> list[str]:
        """One name of each channel, in the order of their numbers."""
        return [names[0] for names in self.names]

    def read(self, references: Sequence[Reference]) -> list[Channel]:
        """The channels that references stand for, units taken from names like "Tip [m/s²]"."""
        columns = [self.load(self.find(reference)) for reference in references]
        split = [split_heading(dataset.name) for dataset in columns]
        return [
            replace(channel, name=name, unit=unit)
            if unit and not channel.unit and self._named(name) == 1
            else channel
            for channel, (name, unit) in zip(columns, split, strict=True)
        ]

    def _named(self, name: str) -> int:
        """How many channels have a name, whatever their units."""
        return sum(split_heading(name_in_file)[0] == name for name_in_file in self.listed)

    def find(self, reference: Reference) -> int:
        """Index (from 0) of the channel that a reference stands for."""
        source, kind, count = str(self.path), self.kind, len(self.names)
        named = any(self.listed)
        here = f"choose one of {listing(self.listed)}" if named else f"choose 1 to {count}"
        if isinstance(reference, int) and not isinstance(reference, bool):
            if 1 <= reference <= count:
                return reference - 1
            raise InputError(source, f"there is no {kind} {reference} among its {count}", here)
        if not isinstance(reference, str):
            problem = f"{reference!r} names no {kind}"
            raise InputError(source, problem, "give a number from 1 or a name")
        places = [index for index, names in enumerate(self.names) if reference in names]
        if not places and self._named(reference) == 1:
            split = [split_heading(name_in_file) for name_in_file in self.listed]
            places = [n for n, (name, unit) in enumerate(split) if unit and name == reference]
        if len(places) == 1:
            return places[0]
        if places:
            problem = f'the name "{reference}" stands at {len(places)} {kind}s'
            remedy = f"give its number, one of {', '.join(str(place + 1) for place in places)}"
            raise InputError(source, problem, remedy)
        if reference.lstrip("/") in self.refusals:
            raise self.refusals[reference.lstrip("/")]
        if "," in reference and all(self._named(part.strip()) for part in reference.split(",")):
            here = "give several as a list, and in the terminal each with an option of its own"
        why = "" if named else f", because there is no header with a name for each {kind}"
        raise InputError(source, f'there is no {kind} "{reference}"{why}', here)


def split_heading(name: str) -> tuple[str, str]:
    """The name without brackets at its end, and what they hold if it is a known unit, else ""."""
    match = _HEADING.fullmatch(name)
    if not match:
        return name, ""
    unit = (match.group(2) or match.group(3) or "").strip()
    return match.group(1), unit if UNIT.fullmatch(unit) and not unit.isdigit() else ""


def listing(names: Sequence[str]) -> str:
    """The names with their numbers, shortened when there are many."""
    shown = [f"{number} {name!r}" for number, name in enumerate(names[:LONGEST_LIST], start=1)]
    if len(names) > LONGEST_LIST:
        shown.append(f"… ({len(names)} in all)")
    return ", ".join(shown)


def library(module: str, path: Path, extra: str = "formats") -> ModuleType:
    """Import the library that reads a format, which an extra of evopem brings along."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        problem = (
            f"reading this format needs the package {module.split('.')[0]}, which is not installed"
        )
        raise InputError(str(path), problem, f'run pip install "evopem[{extra}]"') from None


@contextmanager
def refusing_damage(path: Path, kind: str) -> Iterator[None]:
    """Refuse a file that a library cannot read, with whatever exception it meets the damage."""
    try:
        yield
    except InputError:
        raise
    except Exception:
        refuse_unreadable(path, kind)


def refuse_unreadable(path: Path, kind: str) -> NoReturn:
    """Say that a file is not what its name promises."""
    problem = f"is not a readable {kind} (truncated, damaged, or of another format)"
    raise InputError(str(path), problem, "export or copy the file again and check its extension")
