"""numpy's own files, .npz and .npy, read without loading pickled objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evopem.signals.readers.arrays import channels_of, names_of
from evopem.signals.readers.channels import Channel, Reference, refuse_unreadable


def read(path: Path, references: Sequence[Reference]) -> list[Channel]:
    """Read arrays by name, or by number in the order of the file.

    An ``.npy`` file holds one array: a matrix of columns known by number, or a structured
    array whose fields have names.
    """
    return channels_of(path, _arrays(path), references, "array")


def names(path: Path) -> list[str]:
    """Names of all channels in the order of their numbers, texts such as "1" without names."""
    return names_of(_arrays(path))


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    try:
        content = np.load(path, allow_pickle=False)
        return _members(content) if isinstance(content, np.lib.npyio.NpzFile) else _alone(content)
    except Exception:
        # numpy and zipfile meet damage with ValueError, EOFError, BadZipFile, zlib.error,
        # RuntimeError (encrypted), NotImplementedError (packed in another way), MemoryError …
        refuse_unreadable(path, "numpy file without Python objects")


def _members(content: Any) -> dict[str, NDArray[Any]]:
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


def _alone(content: NDArray[Any]) -> dict[str, NDArray[Any]]:
    if content.dtype.names is None:
        return {"": content}
    return {name: content[name] for name in content.dtype.names}
