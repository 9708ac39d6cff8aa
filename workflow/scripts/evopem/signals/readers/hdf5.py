"""HDF5 files, read by h5py."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evopem.errors import InputError
from evopem.signals.readers.arrays import RATE_NAMES, channels_of
from evopem.signals.readers.channels import Channel, Reference, library, refuse_unreadable


def read(path: Path, references: Sequence[Reference]) -> list[Channel]:
    """Read datasets by their path in the file, or by number in the order of the paths.

    The attributes ``unit`` or ``units`` of a dataset are its unit. The sampling rate is a
    single-number dataset or an attribute of the file named as in `RATE_NAMES`.

    Raises
    ------
    InputError
        When the file is damaged or no HDF5, h5py is missing, or there is no such dataset.
    """
    h5py = library("h5py", path)
    try:
        file = h5py.File(path, "r")
    except OSError:
        refuse_unreadable(path, "HDF5 file")
    with file:
        arrays: dict[str, Any] = {}

        def collect(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.shape is not None:
                arrays[name] = item

        try:
            file.visititems(collect)
            for attribute, value in file.attrs.items():
                if attribute.lower() in RATE_NAMES:
                    arrays[attribute] = np.asarray(value)
            units = {name: _unit(item) for name, item in arrays.items()}
            wanted = [one.lstrip("/") if isinstance(one, str) else one for one in references]
            return channels_of(path, arrays, wanted, "dataset", units)
        except InputError:
            raise
        except Exception:
            # h5py meets damage with OSError, RuntimeError, KeyError, TypeError, ValueError …
            refuse_unreadable(path, "HDF5 file")


def _unit(item: Any) -> str:
    attributes = getattr(item, "attrs", {})
    for name in ("unit", "units"):
        value = attributes.get(name)
        if isinstance(value, bytes):
            value = value.decode("utf-8", errors="replace")
        if isinstance(value, str):
            return value
    return ""
