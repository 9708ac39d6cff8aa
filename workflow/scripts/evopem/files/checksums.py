"""SHA-256 checksums of result files, in the format of ``sha256sum``.

A changed digit in a JSON file is still valid JSON; only a checksum reveals it. Each job writes one
file with the checksums of its outputs, ``checksums/<job>.sha256``, with paths relative to the
folder of the data set, so that ``sha256sum -c`` verifies them from that folder.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from evopem.errors import InputError
from evopem.files.atomic import files_below, write_text

FOLDER = "checksums"
_SUFFIX = ".sha256"


def sha256_of_file(path: str | Path) -> str:
    """SHA-256 of a file's content, as 64 hexadecimal digits."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_checksums(files: Iterable[str | Path], folder: str | Path, job: str) -> None:
    """Write the checksums of a job's outputs to ``<folder>/checksums/<job>.sha256``.

    Lines about the same files that other jobs wrote are removed: other jobs make these files when
    the workflow is divided differently.

    Parameters
    ----------
    files : iterable of path
        Outputs of the job, in `folder` or its subfolders; of a folder, all files in it.
    folder : path
        Folder of the data set, or of the results as a whole.
    job : str
        Name of the job; it may contain slashes, as in ``phases/delay/part-1``.
    """
    folder = Path(folder)
    own = {
        file.relative_to(folder).as_posix(): sha256_of_file(file) for file in _regular_files(files)
    }
    own_file = folder / FOLDER / f"{job}{_SUFFIX}"
    for other_file in _checksum_files(folder):
        if other_file != own_file:
            _remove_lines(other_file, folder, own)
    _write(own_file, own)


def delete_results(folder: str | Path, only: Collection[str] | None = None) -> None:
    """Delete results that jobs have written, and the lines about them.

    Parameters
    ----------
    folder : path
        Folder of the data set.
    only : collection of str, optional
        Their paths relative to the folder; by default all that have a checksum.
    """
    folder = Path(folder)
    paths = {
        path
        for path in _checksums_in(folder)
        if (only is None or path in only)
        # A damaged file of checksums must not name files elsewhere.
        and not Path(path).is_absolute()
        and ".." not in Path(path).parts
    }
    for path in paths:
        (folder / path).unlink(missing_ok=True)
    for file in _checksum_files(folder) if paths else ():
        _remove_lines(file, folder, paths)


def check_replaceable(files: Iterable[str | Path], folder: str | Path) -> None:
    """Refuse to replace files of a folder unless they are there as a job has written them.

    Parameters
    ----------
    files : iterable of path
        Files to write, in `folder` or its subfolders.
    folder : path

    Raises
    ------
    InputError
        Naming a file that is no regular one, has no checksum, or was changed.
    """
    folder = Path(folder)
    known = _checksums_in(folder)
    for file in map(Path, files):
        path = file.relative_to(folder).as_posix()
        in_place = file.is_symlink() or file.exists()
        # The files of checksums have none of their own.
        if not in_place or (path.startswith(f"{FOLDER}/") and file.is_file()):
            continue
        if not file.is_file() or path not in known or not _is_right(file, known[path]):
            raise InputError(
                str(file),
                "is not as evopem wrote it, and would be replaced",
                "choose another folder, or move the file away",
            )


def checksummed(folder: str | Path) -> dict[Path, str]:
    """The checksums of all results of a folder, by their paths."""
    return {Path(folder) / path: value for path, value in _checksums_in(Path(folder)).items()}


def verify_checksums(files: Iterable[str | Path], root: str | Path) -> None:
    """Verify files against the checksums that their jobs wrote.

    A file without a checksum passes, and so does one that does not exist.

    Parameters
    ----------
    files : iterable of path
    root : path
        Folder of the data set, or of the results as a whole. Files elsewhere, such as a user's
        recordings, are not verified.

    Raises
    ------
    InputError
        When a file was changed; the error names it.
    """
    root = Path(root)
    known: dict[Path, dict[str, str]] = {}
    for file in map(Path, files):
        if not file.is_relative_to(root) or not file.is_file():
            continue
        for folder in (up for up in file.parents if up.is_relative_to(root)):
            if folder not in known:
                known[folder] = _checksums_in(folder)
            checksum = known[folder].get(file.relative_to(folder).as_posix())
            if checksum is not None and checksum != sha256_of_file(file):
                raise InputError(
                    str(file),
                    "was changed or damaged after it was written",
                    "delete it and run snakemake again, which writes it anew",
                )


def _regular_files(files: Iterable[str | Path]) -> Iterator[Path]:
    """Files, and those in folders among them, without hidden ones."""
    for file in map(Path, files):
        if file.is_dir():
            yield from (each for each in files_below(file, "") if not each.name.startswith("."))
        else:
            yield file


def _checksum_files(folder: Path) -> list[Path]:
    return files_below(folder / FOLDER, _SUFFIX)


def _checksums_in(folder: Path) -> dict[str, str]:
    """All checksums of a folder, by path relative to it."""
    return {
        path: checksum for file in _checksum_files(folder) for path, checksum in _read(file).items()
    }


def _read(file: Path) -> dict[str, str]:
    """The checksums of one file by path; empty where another job has just removed the file."""
    try:
        lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    except FileNotFoundError:
        return {}
    pairs = (line.split("  ", 1) for line in lines)
    return {pair[1]: pair[0] for pair in pairs if len(pair) == 2}


def _write(file: Path, checksums: dict[str, str]) -> None:
    if checksums:
        write_text(file, "".join(f"{value}  {path}\n" for path, value in checksums.items()))
    else:
        file.unlink(missing_ok=True)


def _remove_lines(file: Path, folder: Path, paths: Iterable[str]) -> None:
    """Remove the lines about given files, and any other line that is not right.

    Two jobs may do this to one file at the same time. Neither writes back a line that the other one
    removes: the outputs of a job do not exist until it has made them, and then differ.
    """
    checksums = _read(file)
    if checksums.keys().isdisjoint(paths):
        return
    removed = set(paths)
    kept = {
        path: checksum
        for path, checksum in checksums.items()
        if path not in removed and _is_right(folder / path, checksum)
    }
    _write(file, kept)


def _is_right(file: Path, checksum: str) -> bool:
    try:
        return sha256_of_file(file) == checksum
    except OSError:
        return False
