"""Zip archives of result files: equal contents give equal bytes."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from pathlib import Path

from evopem.files.atomic import atomic_write

# The earliest time that the format has.
_NO_TIME = (1980, 1, 1, 0, 0, 0)
# The highest level takes ten times as long for a tenth less.
_LEVEL = 1


def pack(archive: str | Path, files: Iterable[str | Path], folder: str | Path) -> None:
    """Write files of a folder into an archive, under their paths in the folder.

    Times and permissions are left out.

    Parameters
    ----------
    archive : path
    files : iterable of path
    folder : path

    Raises
    ------
    InputError
        When the archive cannot be written.
    """
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
