"""Result files: written whole or not at all, the same bytes for the same content."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


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
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
        # A file made inside has the permissions of any new file.
        temporary = Path(folder) / path.name
        yield temporary
        os.replace(temporary, path)  # noqa: PTH105


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


def write_table(path: str | Path, table: pd.DataFrame) -> None:
    """Write a table as CSV with a header; floats keep every bit, a missing value is empty."""
    write_text(path, table.to_csv(index=False, lineterminator="\n"))
