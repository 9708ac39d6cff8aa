"""Atomic writes of text, JSON, tables, arrays and archives; equal content gives equal bytes."""

from __future__ import annotations

import csv
import io
import os
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evopem.errors import InputError

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

TEMPORARY = ".writing-"  # start of the names of temporary folders
_INSTALL = "install it, or evopem with its formats: pip install 'PATH[formats]'"


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Write a file completely or not at all.

    The body of the ``with`` statement writes to a temporary path of the same name, which replaces
    ``path`` in one step. An `InputError` says that the file system refuses, or that something else
    than a file has this path.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise InputError(str(path), "is no regular file and is not replaced", "give another path")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=TEMPORARY) as folder:
            # A file created in the temporary folder has the permissions of any new file, which
            # one made by tempfile.NamedTemporaryFile has not.
            temporary = Path(folder) / path.name
            yield temporary
            os.replace(temporary, path)  # noqa: PTH105
    except OSError as error:
        raise not_written(path, error) from error


def not_written(path: Path, error: OSError) -> InputError:
    """What is said of a file that the file system does not let be written."""
    problem = f"cannot be written ({error.strerror or error})"
    remedy = "free disk space or change the permissions of that folder, and run again"
    return InputError(str(path), problem, remedy)


def files_below(folder: str | Path, ending: str) -> list[Path]:
    """Complete files in a folder and its subfolders whose name has an ending, in their order.

    Other processes may write and delete files there meanwhile.
    """
    files: list[Path] = []
    # Path.rglob raises an error when a folder vanishes while it is read; os.walk does not.
    for parent, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(TEMPORARY)]
        files += [Path(parent) / name for name in names if name.endswith(ending)]
    return sorted(files)


def write_text(path: str | Path, text: str) -> None:
    """Write a text as UTF-8."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_table(path: str | Path, table: Mapping[str, Iterable[Any]] | pd.DataFrame) -> None:
    """Write columns of equal length as CSV with a header; a missing value is empty.

    Floats are written exactly. A job that passes a mapping of arrays need not import pandas.
    """
    columns = [[name, *_texts(table[name])] for name in table.keys()]  # noqa: SIM118
    text, values = io.StringIO(), "".join(map("".join, columns))
    if len(columns) > 1 and not any(mark in values for mark in ',"\r\n'):
        # Twice as fast as a writer, which looks at each character.
        text.writelines(f"{','.join(row)}\n" for row in zip(*columns, strict=True))
    else:
        csv.writer(text, lineterminator="\n").writerows(zip(*columns, strict=True))
    write_text(path, text.getvalue())


def _texts(column: Any) -> list[str]:
    """The values of an array, a Series or any iterable in exact texts."""
    if hasattr(column, "notna"):  # pandas has its own missing values
        column = column.astype(object).where(column.notna(), None)
    values = column.tolist() if hasattr(column, "tolist") else column
    return ["" if value is None or value != value else str(value) for value in values]


def write_parquet(path: str | Path, table: pd.DataFrame) -> None:
    """Write a table as Parquet, which needs pyarrow."""
    try:
        import pyarrow as arrow
        from pyarrow import parquet
    except ImportError:
        problem = "Parquet is written by pyarrow, which is not installed"
        raise InputError(str(path), problem, _INSTALL) from None
    with atomic_write(path) as temporary:
        parquet.write_table(arrow.Table.from_pandas(table, preserve_index=False), temporary)


_NO_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest time that the format has
_LEVEL = 1  # the highest level takes ten times as long for a tenth less


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
