"""MATLAB files: up to version 7 by scipy, version 7.3 (HDF5) by h5py."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers.arrays import StoredArray, channels_of, names_of
from evopem.signals.readers.channels import Channel, Reference, library, refuse_unreadable
from evopem.signals.readers.hdf5 import StoredDataset

T = TypeVar("T")

_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_HDF5_OFFSETS = (0, 512)
"""Version 7.3 puts a block of 512 bytes in front."""


def read(path: Path, references: Sequence[Reference]) -> list[Channel]:
    """Read variables by name or by number in the order of the file.

    The two versions are told apart by content. Fields of a structure are named with points, as
    in ``motor.speed``.
    """
    return _in_file(path, lambda variables: channels_of(path, variables, references, "variable"))


def names(path: Path) -> list[str]:
    """Names of all channels in the order of their numbers."""
    return _in_file(path, names_of)


def _in_file(path: Path, use: Callable[[Mapping[str, StoredArray]], T]) -> T:
    """Call a function with the variables of a file of either version."""
    with path.open("rb") as file:
        beginning = file.read(_HDF5_OFFSETS[-1] + len(_HDF5_SIGNATURE))
    if any(beginning.startswith(_HDF5_SIGNATURE, offset) for offset in _HDF5_OFFSETS):
        return _in_hdf5(path, use)
    return use(_read_level_5(path))


def _read_level_5(path: Path) -> dict[str, NDArray[Any]]:
    from scipy.io import loadmat

    try:
        # Not mat_dtype=True: it drops the imaginary part of complex variables without a message.
        content = loadmat(str(path), struct_as_record=True)
    except Exception:
        # scipy's parser meets damage with nearly any exception: ValueError, TypeError,
        # OverflowError, zlib.error, its own MatReadError …
        refuse_unreadable(path, "MATLAB file")
    variables: dict[str, NDArray[Any]] = {}
    for name, value in content.items():
        # Objects of classes come without a name; scipy's own entries begin with underscores.
        if isinstance(name, str) and not name.startswith("__"):
            _flatten(name, value, variables)
    return variables


def _flatten(name: str, value: Any, variables: dict[str, NDArray[Any]]) -> None:
    """Add a variable, or the fields of a 1 x 1 structure under dotted names."""
    if not isinstance(value, np.ndarray):
        return
    if value.dtype.names is None:
        variables[name] = value
    elif value.size == 1:
        for field in value.dtype.names:
            _flatten(f"{name}.{field}", value.reshape(-1)[0][field], variables)


def _in_hdf5(path: Path, use: Callable[[Mapping[str, StoredArray]], T]) -> T:
    h5py = library("h5py", path)
    variables: dict[str, StoredDataset] = {}
    sparse: list[str] = []

    def collect(name: str, item: Any) -> None:
        # Groups with a number sign hold the contents of cells and objects.
        if name.startswith("#") or any(name.startswith(group) for group in sparse):
            return
        if "MATLAB_sparse" in item.attrs:
            sparse.append(f"{name}/")
        # An empty variable is stored as the lengths of its dimensions.
        if not isinstance(item, h5py.Dataset) or item.attrs.get("MATLAB_empty", 0):
            return
        is_text = item.attrs.get("MATLAB_class", b"") in (b"char", b"cell")
        variables[name.replace("/", ".")] = StoredDataset(
            path, item, transposed=True, is_numeric=not is_text
        )

    try:
        with h5py.File(path, "r") as file:
            file.visititems(collect)
            return use(variables)
    except InputError:
        raise
    except Exception:
        # h5py meets damage with OSError, RuntimeError, KeyError, TypeError, ValueError …
        refuse_unreadable(path, "MATLAB 7.3 file")
