"""Named arrays on disk: written whole or not at all, the same bytes for the same content."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.files.atomic import atomic_write


def save_arrays(path: str | Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write named arrays to one uncompressed ``.npz``; equal arrays give equal bytes.

    Parameters
    ----------
    path : str or Path
        File to write; an existing one is replaced in one step.
    arrays : mapping of str to ndarray
        Arrays of numbers or of text; none may need pickling.
    """
    # numpy stamps every member with 1980-01-01, so the bytes depend on the content alone.
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **dict(arrays))


def load_arrays(path: str | Path, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Read the named arrays of an ``.npz`` that `save_arrays` wrote.

    Raises
    ------
    InputError
        When the file is missing, damaged or lacks one of the names.
    """
    remedy = "make the file again by running the step that writes it"
    try:
        with np.load(Path(path), allow_pickle=False) as stored:
            return {name: stored[name] for name in names}
    except FileNotFoundError:
        raise InputError(str(path), "there is no such file", remedy) from None
    except KeyError as missing:
        raise InputError(str(path), f"holds no array {missing}", remedy) from None
    except (OSError, ValueError, EOFError, BadZipFile):
        raise InputError(str(path), "is not a readable array file", remedy) from None
