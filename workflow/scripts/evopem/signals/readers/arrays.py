"""Channels out of named arrays: what MATLAB, numpy and HDF5 files have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers.channels import Channel, Reference, find_channel

RATE_NAMES = ("sampling_rate", "sample_rate", "sampling_frequency", "fs")
"""A single number of such a name (in any case) in a file is its sampling rate in Hz."""


class StoredArray(Protocol):
    """An array, in memory or still in its file."""

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
) -> list[Channel]:
    """The channels that references mean among named arrays.

    A vector is one channel under the array's name. A matrix is one channel a column, named
    ``name:1``, ``name:2``, …; where it has fewer rows than columns, one a row. Numbers count
    all of these in the order of the file. Single numbers, texts and objects are no channels.

    Parameters
    ----------
    path : Path
    arrays : mapping of str to array
    references : sequence of int or str
    kind : str
        What the format calls an array.
    units : mapping of str to str, optional
        Units of arrays by name.

    Raises
    ------
    InputError
        When there is no such channel, or a matrix is named without its column.
    """
    rate = _stated_rate(arrays)
    places = [
        (name, column)
        for name, array in arrays.items()
        for column in _columns_of(array.shape, array.dtype)
    ]
    names = [name if column is None else f"{name}:{column + 1}" for name, column in places]
    channels = []
    for reference in references:
        if isinstance(reference, str) and reference not in names and reference in arrays:
            _refuse_array(path, reference, arrays[reference], kind)
        index = find_channel(path, reference, names, kind)
        name, column = places[index]
        values = np.asarray(arrays[name][()])
        channels.append(
            Channel(
                name=names[index].lstrip(":"),
                values=_signal(values, column),
                unit=(units or {}).get(name, ""),
                sampling_rate=rate,
            )
        )
    return channels


def _columns_of(shape: tuple[int, ...], dtype: np.dtype) -> list[int | None]:
    """The channels in an array of this shape: none, itself (None), or its columns."""
    lengths = [length for length in shape if length != 1]
    if dtype.kind not in "fiubcM" or not lengths or 0 in lengths or len(lengths) > 2:
        return []
    return [None] if len(lengths) == 1 else list(range(min(lengths)))


def _signal(values: NDArray, column: int | None) -> NDArray:
    if column is None:
        return values.reshape(-1)
    matrix = values.squeeze()
    return matrix[:, column] if matrix.shape[0] >= matrix.shape[1] else matrix[column]


def _stated_rate(arrays: Mapping[str, StoredArray]) -> float | None:
    for name, array in arrays.items():
        single = int(np.prod(array.shape)) == 1 and array.dtype.kind in "fiu"
        if single and name.rsplit("/")[-1].rsplit(".")[-1].lower() in RATE_NAMES:
            rate = float(np.asarray(array[()]).reshape(-1)[0])
            return rate if np.isfinite(rate) and rate > 0 else None
    return None


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
    holds = size if array.dtype.kind in "fiubcM" else f"{size} of text or objects"
    raise InputError(
        str(path),
        f"it is no signal but {holds}",
        "choose an array of numbers with one value a sample",
        f'{kind} "{name}"',
    )
