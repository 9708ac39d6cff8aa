"""Seals: a digest beside each result, so that none is read again that was changed meanwhile.

A flipped digit in a JSON file is still JSON; only a digest tells it from what was written. Each
data set's folder holds them in ``seals/``, a small text file for each result, under its own name.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from evopem.errors import InputError
from evopem.files.atomic import write_text

FOLDER = "seals"


def seal(files: Iterable[str | Path], root: str | Path) -> None:
    """Keep the digests of result files that lie below `root` in its folder of seals."""
    root = Path(root)
    for file in map(Path, files):
        write_text(_seal_of(file, root), _digest(file) + "\n")


def check_seals(files: Iterable[str | Path]) -> None:
    """Refuse a result file that is not what its job wrote; one without a seal passes.

    Raises
    ------
    InputError
        Naming the file.
    """
    for file in map(Path, files):
        kept = next(
            (
                _seal_of(file, folder)
                for folder in file.parents
                if folder.name and _seal_of(file, folder).is_file()
            ),
            None,
        )
        if kept is None or not file.is_file():
            continue
        if kept.read_text(encoding="utf-8").strip() != _digest(file):
            raise InputError(
                str(file),
                "it was changed or damaged after it was written",
                "delete it and run snakemake again, which makes it anew",
            )


def _seal_of(file: Path, root: Path) -> Path:
    return root / FOLDER / file.relative_to(root).with_name(f"{file.name}.sha256")


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
