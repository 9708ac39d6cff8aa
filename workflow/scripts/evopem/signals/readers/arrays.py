"""Channels out of named arrays, for MATLAB, numpy and HDF5 files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers.channels import Channel, Reference, find_channel

RATE_NAMES = ("sampling_rate", "sample_rate", "sampling_frequency", "fs")
"""A single number of such a name, in upper or lower case, is a sampling rate."""

_HERTZ = {
    "": 1.0, "Hz": 1.0, "hz": 1.0, "HZ": 1.0, "1/s": 1.0, "s^-1": 1.0, "S/s": 1.0,
    "samples/s": 1.0, "kHz": 1e3, "KHz": 1e3, "kS/s": 1e3, "MHz": 1e6, "MS/s": 1e6,
}  # fmt: skip
_KINDS = "fiubcMm"


class StoredArray(Protocol):
    """An array in memory or in its file."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the dimensions."""

    @property
    def dtype(self) -> np.dtype:
        """Type of the elements."""

    def __getitem__(self, index: tuple[()]) -> Any:
        """The whole array, for the index ``()``."""


def channels_of(
    path: Path,
    arrays: Mapping[str, StoredArray],
    references: Sequence[Reference],
    kind: str,
    units: Mapping[str, str] | None = None,
    attributes: Mapping[str, Any] | None = None,
) -> list[Channel]:
    """The channels that references stand for among named arrays.

    A vector is one channel under the array's name. A matrix is one channel for each column,
    named ``name:1``, ``name:2``, …; with fewer rows than columns, one for each row. Numbers
    count all of these in the order of the file. Single numbers, texts and objects are no
    channels.

    A channel's sampling rate is the single number named as in `RATE_NAMES` in the channel's own
    group, else in the nearest group around it. Groups are separated by points or slashes.

    ``kind`` is what the format calls an array; units and attributes are given by their path in the
    file.
    """
    units = units or {}
    rates = _stated_rates({**arrays, **(attributes or {})}, units)
    places = _places(arrays)
    names = [_name(*place) for place in places]
    channels = []
    for reference in references:
        if isinstance(reference, str) and reference not in names and reference in arrays:
            _refuse_array(path, reference, arrays[reference], kind)
        index = find_channel(path, reference, names, kind)
        name, column = places[index]
        rate, problem = _rate_of(name, rates)
        channels.append(
            Channel(
                name=names[index].lstrip(":"),
                values=_signal(np.asarray(arrays[name][()]), column),
                unit=units.get(name, ""),
                sampling_rate=rate,
                rate_problem=problem,
            )
        )
    return channels


def names_of(arrays: Mapping[str, StoredArray]) -> list[str]:
    """The channels among named arrays, as :func:`channels_of` counts and names them."""
    return [_name(*place).lstrip(":") for place in _places(arrays)]


def _places(arrays: Mapping[str, StoredArray]) -> list[tuple[str, int | None]]:
    """The array of each channel, and its column there (from 0), None for a vector."""
    return [
        (name, column)
        for name, array in arrays.items()
        for column in _columns_of(array.shape, array.dtype)
    ]


def _name(array: str, column: int | None) -> str:
    return array if column is None else f"{array}:{column + 1}"


def _columns_of(shape: tuple[int, ...], dtype: np.dtype) -> list[int | None]:
    """The channels in an array of this shape: none, itself (None), or its columns."""
    lengths = [length for length in shape if length != 1]
    if dtype.kind not in _KINDS or not lengths or 0 in lengths or len(lengths) > 2:
        return []
    return [None] if len(lengths) == 1 else list(range(min(lengths)))


def _signal(values: NDArray, column: int | None) -> NDArray:
    if column is None:
        return values.reshape(-1)
    matrix = values.squeeze()
    return matrix[:, column] if matrix.shape[0] >= matrix.shape[1] else matrix[column]


def _path(name: str) -> tuple[str, ...]:
    return tuple(part for part in re.split(r"[/.]", name) if part)


def _stated_rates(
    numbers: Mapping[str, Any], units: Mapping[str, str]
) -> dict[str, tuple[float, str]]:
    """Every sampling rate in a file by its path: its value (Hz) and what is wrong with it."""
    rates = {}
    for name, value in numbers.items():
        parts = _path(name)
        if not parts or parts[-1].lower() not in RATE_NAMES:
            continue
        array = value if hasattr(value, "dtype") else np.asarray(value)
        if int(np.prod(array.shape)) != 1 or array.dtype.kind not in "fiu":
            continue
        unit = units.get(name, "").strip()
        rate = float(np.asarray(array[()]).reshape(-1)[0]) * _HERTZ.get(unit, 1.0)
        problem = ""
        if unit not in _HERTZ:
            problem = f'its "{name}" is in the unit "{unit}", which is not known'
        elif not (np.isfinite(rate) and rate > 0):
            problem = f'its "{name}" is {rate:g} Hz'
        rates[name] = (rate, problem)
    return rates


def _rate_of(name: str, rates: Mapping[str, tuple[float, str]]) -> tuple[float | None, str]:
    """The sampling rate of the nearest group around an array, or why there is none."""
    own = _path(name)
    for depth in range(len(own), -1, -1):
        here = {key: rate for key, rate in rates.items() if _path(key)[:-1] == own[:depth]}
        if not here:
            continue
        problems = [problem for _, problem in here.values() if problem]
        values = {rate for rate, _ in here.values()}
        if problems:
            return None, problems[0]
        if len(values) > 1:
            stated = " and ".join(f'"{key}" {rate:g} Hz' for key, (rate, _) in here.items())
            return None, f"it states {stated}"
        return values.pop(), ""
    if rates:
        key, (rate, _) = next(iter(rates.items()))
        return None, f'its "{key}" states {rate:g} Hz for another group than that of "{name}"'
    return None, ""


def _refuse_array(path: Path, name: str, array: StoredArray, kind: str) -> None:
    columns = _columns_of(array.shape, array.dtype)
    size = " x ".join(str(length) for length in array.shape) or "a single number"
    if columns:
        raise InputError(
            str(path),
            f"it is a matrix, {size}, where one signal is needed",
            f"add the number of the column, from {name}:1 to {name}:{len(columns)}",
            f'{kind} "{name}"',
        )
    holds = size if array.dtype.kind in _KINDS else f"{size} of text or objects"
    raise InputError(
        str(path),
        f"it is no signal but {holds}",
        "choose an array of numbers with one value a sample",
        f'{kind} "{name}"',
    )
