"""MATLAB files: up to version 7 by scipy, version 7.3 (HDF5) as HDF5 files."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # whose parts load on first use

from evopem.signals.readers import hdf5
from evopem.signals.readers.numpy_files import StoredArray, contents_of, in_memory
from evopem.signals.readers.open_file import Contents, refusing_damage

_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_HDF5_OFFSETS = (0, 512)  # version 7.3 puts a block of 512 bytes in front


@contextmanager
def opened(path: Path) -> Iterator[Contents]:
    """The variables of a file; fields of a structure are named with points, as ``motor.speed``."""
    with path.open("rb") as file:
        beginning = file.read(_HDF5_OFFSETS[-1] + len(_HDF5_SIGNATURE))
    if any(beginning.startswith(_HDF5_SIGNATURE, offset) for offset in _HDF5_OFFSETS):
        with hdf5.opened(path, is_matlab=True) as contents:
            yield contents
    else:
        yield contents_of(path, _read_level_5(path), "variable")


def _read_level_5(path: Path) -> dict[str, StoredArray]:
    with refusing_damage(path, "MATLAB file"):
        # Not mat_dtype=True: it drops the imaginary part of complex variables without a message.
        content = scipy.io.loadmat(str(path), struct_as_record=True)
    variables: dict[str, StoredArray] = {}
    for name, value in content.items():
        # Objects of classes come without a name; scipy's own entries begin with underscores.
        if isinstance(name, str) and not name.startswith("__"):
            _flatten(name, value, variables)
    return variables


def _flatten(name: str, value: Any, variables: dict[str, StoredArray]) -> None:
    """Add a variable, or the fields of a 1 x 1 structure under dotted names."""
    if not isinstance(value, np.ndarray):
        return
    if value.dtype.names is None:
        variables[name] = in_memory(value)
    elif value.size == 1:
        for field in value.dtype.names:
            _flatten(f"{name}.{field}", value.reshape(-1)[0][field], variables)
