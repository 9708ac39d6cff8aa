"""Zip archives of result files and of arrays: equal contents give equal bytes."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evopem.errors import InputError
from evopem.files.atomic import atomic_write

if TYPE_CHECKING:
    from numpy.typing import NDArray

# The earliest time that the format has.
_NO_TIME = (1980, 1, 1, 0, 0, 0)
# The highest level takes ten times as long for a tenth less.
_LEVEL = 1


def pack(archive: str | Path, files: Iterable[str | Path], folder: str | Path) -> None:
    """Write files of a folder into an archive, under their paths in it, without times."""
    with (
        atomic_write(archive) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as packed,
    ):
        for file in sorted(map(Path, files)):
            member = zipfile.ZipInfo(file.relative_to(folder).as_posix(), _NO_TIME)
            member.external_attr = 0o644 << 16
            member.compress_type = zipfile.ZIP_DEFLATED
            packed.writestr(member, file.read_bytes())


def member_of(archive: str | Path, name: str) -> bytes | None:
    """Content of a file in an archive; None where there is none, or the archive is damaged."""
    try:
        with zipfile.ZipFile(archive) as packed:
            return packed.read(name)
    except (OSError, KeyError, zipfile.BadZipFile):
        return None


def save_arrays(path: str | Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write named arrays of numbers or of text to one uncompressed ``.npz``."""
    import numpy as np

    # numpy stamps every member with 1980-01-01, so the bytes depend on the content alone.
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **dict(arrays))


def load_arrays(path: str | Path, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Read the named arrays of an ``.npz``; an `InputError` says what is missing or damaged."""
    import numpy as np

    remedy = "make the file again by running the step that writes it"
    try:
        with np.load(Path(path), allow_pickle=False) as stored:
            return {name: stored[name] for name in names}
    except FileNotFoundError:
        raise InputError(str(path), "there is no such file", remedy) from None
    except KeyError as missing:
        raise InputError(str(path), f"holds no array {missing}", remedy) from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        raise InputError(str(path), "is not a readable array file", remedy) from None
