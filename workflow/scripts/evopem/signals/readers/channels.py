"""The channel that every reader returns, and the errors that readers share."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from numpy.typing import NDArray

from evopem.errors import InputError

Reference = int | str
"""A channel by its number, counted from 1, or by its name."""

LONGEST_LIST = 20
"""An error lists at most this many channel names; a file may hold thousands."""


@dataclass(frozen=True)
class Channel:
    """One column or channel, as its file holds it."""

    name: str  # what the file calls it; empty when the file has no names
    values: NDArray[Any]  # (N,) numbers, or dates (datetime64)
    unit: str = ""  # as the file states it; empty when it does not
    sampling_rate: float | None = None  # Hz, when the file states one for this channel
    rate_problem: str = ""  # why a rate that the file states is not used, in a clause
    start: float | None = None  # time (s) of the first sample, when the file states one


def find_channel(path: Path, reference: Reference, names: Sequence[str], kind: str) -> int:
    """Index (from 0) of the channel that a reference stands for.

    A reference is a number from 1, or one of the names, which are empty for channels without one;
    ``kind`` is what the format calls a channel ("column", "variable", …).
    """
    here = f"choose one of {listing(names)}" if any(names) else f"choose 1 to {len(names)}"
    if isinstance(reference, int) and not isinstance(reference, bool):
        if 1 <= reference <= len(names):
            return reference - 1
        raise InputError(str(path), f"there is no {kind} {reference} among its {len(names)}", here)
    if not isinstance(reference, str):
        raise InputError(
            str(path), f"{reference!r} names no {kind}", "give a number from 1 or a name"
        )
    places = [index for index, name in enumerate(names) if name == reference]
    if len(places) == 1:
        return places[0]
    if places:
        raise InputError(
            str(path),
            f'the name "{reference}" stands at {len(places)} {kind}s',
            f"give its number, one of {', '.join(str(place + 1) for place in places)}",
        )
    raise InputError(str(path), f'there is no {kind} "{reference}"', here)


def listing(names: Sequence[str]) -> str:
    """The names with their numbers, shortened when there are many."""
    shown = [f"{number} {name!r}" for number, name in enumerate(names[:LONGEST_LIST], start=1)]
    if len(names) > LONGEST_LIST:
        shown.append(f"… ({len(names)} in all)")
    return ", ".join(shown)


def library(module: str, path: Path) -> ModuleType:
    """Import the library that reads a format."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        raise InputError(
            str(path),
            f"reading this format needs the package {module.split('.')[0]}, which is not installed",
            'run pip install "evopem[formats]"',
        ) from None


def refuse_unreadable(path: Path, kind: str) -> NoReturn:
    """Say that a file is not what its name promises."""
    raise InputError(
        str(path),
        f"is not a readable {kind} (truncated, damaged, or of another format)",
        "export or copy the file again and check its extension",
    )
