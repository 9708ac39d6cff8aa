"""Result files: written whole or not at all, the same bytes for the same content."""

from __future__ import annotations

import csv
import io
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evopem.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

_INSTALL = "install it, or evopem with its formats: pip install 'PATH[formats]'"


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """Offer a temporary path beside `path`, and put the file in place once it is complete.

    Parameters
    ----------
    path : path
        Where the file is to be. A file already there stays as it is when writing fails.

    Yields
    ------
    Path
        Where to write; it ends like `path`.

    Raises
    ------
    InputError
        When the file system refuses: a full disk, a folder that may not be written to.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
            # A file made inside has the permissions of any new file.
            temporary = Path(folder) / path.name
            yield temporary
            os.replace(temporary, path)  # noqa: PTH105
    except OSError as error:
        raise InputError(
            str(path),
            f"cannot be written ({error.strerror or error})",
            "make room or give permission there, and run again",
        ) from error


def write_text(path: str | Path, text: str) -> None:
    """Write a text as UTF-8."""
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_json(path: str | Path, content: Mapping[str, Any] | Sequence[Any]) -> None:
    """Write indented JSON; floats keep every bit, and NaN is refused.

    Raises
    ------
    ValueError
        When a number is not finite.
    """
    write_text(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_table(path: str | Path, table: Mapping[str, Iterable[Any]] | pd.DataFrame) -> None:
    """Write columns as CSV with a header; floats keep every bit, a missing value is empty.

    Parameters
    ----------
    path : path
    table : mapping or DataFrame
        Columns of equal length, by name. (A mapping of arrays spares a job the import of pandas.)
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.keys())
    columns = [_python_values(table[name]) for name in table.keys()]  # noqa: SIM118
    writer.writerows(zip(*columns, strict=True))
    write_text(path, text.getvalue())


def _python_values(column: Any) -> list[Any]:
    """List the values of an array, a Series or any iterable as Python's own: exact as text."""
    if hasattr(column, "notna"):  # pandas has missing values of its own
        column = column.astype(object).where(column.notna(), None)
    values = column.tolist() if hasattr(column, "tolist") else list(column)
    return ["" if value is None or value != value else value for value in values]


def write_parquet(path: str | Path, table: pd.DataFrame) -> None:
    """Write a table as Parquet.

    Raises
    ------
    InputError
        When pyarrow is not installed.
    """
    try:
        import pyarrow as arrow
        from pyarrow import parquet
    except ImportError:
        raise InputError(
            str(path), "Parquet is written by pyarrow, which is not installed", _INSTALL
        ) from None
    with whole(path) as temporary:
        parquet.write_table(arrow.Table.from_pandas(table, preserve_index=False), temporary)
