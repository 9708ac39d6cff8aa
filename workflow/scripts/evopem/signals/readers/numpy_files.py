"""Channels out of named arrays, for MATLAB, HDF5 and numpy's own files, which are read here."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers.open_file import Channel, Contents, refusing_damage

RATE_NAMES = ("sampling_rate", "sample_rate", "sampling_frequency", "fs")
"""A single number of such a name, in upper or lower case, is a sampling rate."""

_HERTZ = {
    "": 1.0, "Hz": 1.0, "hz": 1.0, "HZ": 1.0, "1/s": 1.0, "s^-1": 1.0, "S/s": 1.0,
    "samples/s": 1.0, "kHz": 1e3, "KHz": 1e3, "kS/s": 1e3, "MHz": 1e6, "MS/s": 1e6,
}  # fmt: skip
_KINDS = "fiubcMm"


class StoredArray(NamedTuple):
    """An array in memory, or in its file, from which it is loaded when it is asked for."""

    shape: tuple[int, ...]
    dtype: np.dtype
    load: Callable[[], NDArray[Any]]


def in_memory(array: NDArray[Any]) -> StoredArray:
    """An array that is loaded already."""
    return StoredArray(array.shape, array.dtype, lambda: array)


@contextmanager
def opened(path: Path) -> Iterator[Contents]:
    """An ``.npz`` file, or an ``.npy`` file of columns or of records, without pickled objects."""
    with refusing_damage(path, "numpy file without Python objects"):
        arrays = _arrays(np.load(path, allow_pickle=False))
    yield contents_of(path, {name: in_memory(array) for name, array in arrays.items()}, "array")


def _arrays(content: Any) -> dict[str, NDArray[Any]]:
    if not isinstance(content, np.lib.npyio.NpzFile):
        fields = content.dtype.names
        return {"": content} if fields is None else {name: content[name] for name in fields}
    arrays: dict[str, NDArray[Any]] = {}
    with content:
        for name in content.files:
            try:
                arrays[name] = content[name]
            except ValueError as refusal:
                if "allow_pickle" not in str(refusal):
                    raise
                # An array of Python objects is not loaded and is no channel.
                arrays[name] = np.empty((), dtype=object)
    return arrays


def contents_of(
    path: Path,
    arrays: Mapping[str, StoredArray],
    kind: str,
    units: Mapping[str, str] | None = None,
    attributes: Mapping[str, StoredArray] | None = None,
) -> Contents:
    """The channels among named arrays; ``kind`` is what the format calls an array.

    A vector is one channel, a matrix one for each column, ``name:1``, … (or for each row).
    The sampling rate is the single number named as in `RATE_NAMES` in the nearest group.
    """
    units = units or {}
    rates = _stated_rates({**arrays, **(attributes or {})}, units)
    columns = {name: _columns_of(array.shape, array.dtype) for name, array in arrays.items()}
    places = [(name, column) for name, array in columns.items() for column in array]

    def load(index: int) -> Channel:
        name, column = places[index]
        values = np.asarray(arrays[name].load())
        if column is None:
            values = values.reshape(-1)
        else:
            values = values.squeeze()
            values = values[:, column] if values.shape[0] >= values.shape[1] else values[column]
        return Channel(names[index], values, units.get(name, ""), *_rate_of(name, rates))

    names = [n if column is None else f"{n}:{column + 1}".lstrip(":") for n, column in places]
    listed = [(name, f"/{name}") if kind == "dataset" else (name,) for name in names]
    refusals = {
        name: _no_signal(path, f'{kind} "{name}"', name, array, columns[name])
        for name, array in arrays.items()
        if columns[name] != [None]
    }
    return Contents(path, kind, listed, load, refusals)


def _columns_of(shape: tuple[int, ...], dtype: np.dtype) -> list[int | None]:
    """The channels in an array of this shape: none, itself (None), or its columns."""
    lengths = [length for length in shape if length != 1]
    if dtype.kind not in _KINDS or not lengths or 0 in lengths or len(lengths) > 2:
        return []
    return [None] if len(lengths) == 1 else list(range(min(lengths)))


def _path(name: str) -> tuple[str, ...]:
    return tuple(part for part in re.split(r"[/.]", name) if part)


def _stated_rates(
    numbers: Mapping[str, StoredArray], units: Mapping[str, str]
) -> dict[str, tuple[float, str]]:
    """Every sampling rate in a file by its path: its value (Hz) and what is wrong with it."""
    rates = {}
    for name, array in numbers.items():
        parts = _path(name)
        if not parts or parts[-1].lower() not in RATE_NAMES:
            continue
        if int(np.prod(array.shape)) != 1 or array.dtype.kind not in "fiu":
            continue
        unit = units.get(name, "").strip()
        rate = float(np.asarray(array.load()).reshape(-1)[0]) * _HERTZ.get(unit, 1.0)
        problem = ""
        if unit not in _HERTZ:
            problem = f'its "{name}" is in the unit "{unit}", which is not known'
        elif not (np.isfinite(rate) and rate > 0):
            problem = f'its "{name}" is {rate:g} Hz'
        rates[name] = (rate, problem)
    return rates


def _rate_of(name: str, rates: Mapping[str, tuple[float, str]]) -> tuple[float | None, str]:
    """The sampling rate of the nearest group around an array, or why there is none."""
    path = _path(name)
    for depth in range(len(path), -1, -1):
        here = {key: rate for key, rate in rates.items() if _path(key)[:-1] == path[:depth]}
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


def _no_signal(
    path: Path, place: str, name: str, array: StoredArray, columns: Sequence[int | None]
) -> InputError:
    size = " x ".join(str(length) for length in array.shape) or "a single number"
    if columns:
        problem = f"it is a matrix, {size}, where one signal is needed"
        remedy = f"add the number of the column, from {name}:1 to {name}:{len(columns)}"
    else:
        problem = f"it is no signal but {size}"
        problem += "" if array.dtype.kind in _KINDS else " of text or objects"
        remedy = "choose an array of numbers with one value a sample"
    return InputError(str(path), problem, remedy, place)
