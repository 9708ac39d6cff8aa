"""SHA-256 checksums of result files, in the format of ``sha256sum``.

Each job writes ``checksums/<job>.sha256`` with paths relative to the folder of the data set, and in
comments the results that it has read, as they were then.
"""

import hashlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from evopem.errors import InputError, checked_path
from evopem.files.atomic import files_below, not_written, write_text

FOLDER = "checksums"
COMMAND = "evopem"
"""The job of results that the command made, or a notebook: those of rules have other names."""
_SUFFIX = ".sha256"
_INPUT = "# from "


def sha256_of_file(path: str | Path) -> str:
    """SHA-256 of a file's content, as 64 hexadecimal digits."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_checksums(
    files: Iterable[str | Path], folder: str | Path, job: str, inputs: Iterable[str | Path] = ()
) -> None:
    """Write the checksums of a job's outputs to ``<folder>/checksums/<job>.sha256``.

    Of a folder among them, those of all files in it.  Lines about the same files that other jobs
    wrote are removed: other jobs make these files when the workflow is divided differently.
    ``inputs``: those that are results with a checksum are kept beside it.
    """
    folder, known = Path(folder), checksummed(folder)
    sums = {
        file.relative_to(folder).as_posix(): sha256_of_file(file) for file in _regular_files(files)
    }
    read = {
        file.relative_to(folder).as_posix(): known[file]
        for file in map(Path, inputs)
        if file in known
    }
    own_file = folder / FOLDER / f"{job}{_SUFFIX}"
    for other_file in _checksum_files(folder):
        if other_file != own_file:
            _remove_lines(other_file, folder, sums)
    _write(own_file, sums, read)


def delete_results(folder: str | Path, only: Collection[str] | None = None) -> None:
    """Delete results that have a checksum, and the lines about them.

    ``only``: their paths relative to the folder; by default all.
    """
    folder = Path(folder)
    # A damaged file of checksums must not name files elsewhere.
    here = [file.relative_to(folder) for file in checksummed(folder) if file.is_relative_to(folder)]
    names = {path.as_posix() for path in here if ".." not in path.parts}
    paths = names if only is None else names.intersection(only)
    for path in paths:
        (folder / path).unlink(missing_ok=True)
    for file in _checksum_files(folder) if paths else ():
        _remove_lines(file, folder, paths)


def check_replaceable(files: Iterable[str | Path], folder: str | Path) -> None:
    """Refuse to replace files of a folder unless they are there as a job has written them."""
    known = checksummed(folder)
    for file in map(Path, files):
        in_place = file.is_symlink() or file.exists()
        # The files of checksums have none of their own.
        of_checksums = file.is_relative_to(Path(folder) / FOLDER) and file.is_file()
        if in_place and not of_checksums and not _is_right(file, known.get(file)):
            remedy = "choose another folder, or move the file away"
            raise InputError(str(file), "is not as evopem wrote it, and would be replaced", remedy)


def checksummed(folder: str | Path) -> dict[Path, str]:
    """The checksums of all results of a folder, by their paths."""
    read = [_read(file)[0] for file in _checksum_files(Path(folder))]
    return {Path(folder) / path: value for made in read for path, value in made.items()}


def sources(folder: str | Path) -> Iterator[tuple[Path, Path, str]]:
    """Each result with each result that its job had read, and the checksum that this had then."""
    folder = Path(folder)
    for file in _checksum_files(folder):
        made, read = _read(file)
        for path, checksum in read.items() if made else ():
            yield folder / next(iter(made)), folder / path, checksum


def changed_results(folder: str | Path) -> Iterator[str]:
    """Results of a folder that are not as their jobs wrote them, among those touched since then."""
    for file in _checksum_files(Path(folder)):
        written = file.stat().st_mtime_ns
        for path, checksum in _read(file)[0].items():
            result = Path(folder) / path
            touched = result.is_file() and result.stat().st_mtime_ns > written
            if touched and not _is_right(result, checksum):
                yield str(result)


GENERATOR = '<meta name="generator" content="evopem">'
"""Mark of a page that evopem wrote, in its head."""


def check_page(path: str | Path) -> None:
    """Refuse to replace what is no page, or a result, by a page."""
    check_own(checked_path("page", path), "page of evopem", lambda file: has_mark(file, GENERATOR))


def write_page(path: str | Path, text: str) -> None:
    """Write a page, with :data:`GENERATOR` at its beginning, to a path that a user gave."""
    check_page(path)
    write_text(path, text)


def check_own(path: Path, kind: str, is_own: Callable[[Path], bool]) -> None:
    """Refuse to replace a result, or what is not a file of evopem of this kind."""
    problem = ""
    try:
        if path.resolve() in checksummed(path.resolve().parent):
            problem = "is a result"
        elif path.exists() and not path.is_file():
            problem = "is no regular file"
        elif path.is_file() and path.stat().st_size > 0 and not is_own(path):
            problem = f"is no {kind}"
    except OSError as error:
        raise not_written(path, error) from None
    if problem:
        raise InputError(str(path), f"{problem} and is not replaced", "give another path")


def has_mark(path: Path, mark: str) -> bool:
    """Whether a mark is among the first characters of a file that can be read."""
    try:
        with path.open("rb") as file:
            return mark.encode() in file.read(2000)
    except OSError:
        return False


def program_of(job: str) -> str:
    """The program that runs a job."""
    return COMMAND if job == COMMAND else "snakemake"


def again(file: str | Path) -> str:
    """The remedy for a result, or its folder: what makes it anew."""
    made = f"{FOLDER}/{COMMAND}{_SUFFIX}"
    of_command = any((up / made).is_file() for up in (Path(file), *Path(file).absolute().parents))
    return f"run {program_of(COMMAND if of_command else '')} again"


def rewritten(file: str | Path) -> str:
    """The remedy for a result that cannot be used."""
    return f"delete the file and {again(file)}, which writes it anew"


def verify_checksums(files: Iterable[str | Path], root: str | Path) -> None:
    """Verify files against the checksums that their jobs wrote; an `InputError` names one.

    A file without a checksum passes, and so does one that does not exist, or lies elsewhere than
    below ``root``, such as a user's recording.
    """
    root = Path(root)
    known: dict[Path, dict[Path, str]] = {}
    for file in map(Path, files):
        if not file.is_relative_to(root) or not file.is_file():
            continue
        for folder in (up for up in file.parents if up.is_relative_to(root)):
            if folder not in known:
                known[folder] = checksummed(folder)
            checksum = known[folder].get(file)
            if checksum is not None and not _is_right(file, checksum):
                remedy = f"delete it and {again(file)}, which writes it anew"
                raise InputError(str(file), "was changed or damaged after it was written", remedy)


def _regular_files(files: Iterable[str | Path]) -> Iterator[Path]:
    """Files, and those in folders among them, without hidden ones."""
    for file in map(Path, files):
        if file.is_dir():
            yield from (below for below in files_below(file, "") if not below.name.startswith("."))
        else:
            yield file


def _checksum_files(folder: Path) -> list[Path]:
    return files_below(folder / FOLDER, _SUFFIX)


def _read(file: Path) -> tuple[dict[str, str], dict[str, str]]:
    """The checksums of outputs and inputs by path; none where another job has removed the file."""
    made: dict[str, str] = {}
    read: dict[str, str] = {}
    with suppress(FileNotFoundError):
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
            checksum, _, path = line.removeprefix(_INPUT).partition("  ")
            if path:
                (read if line.startswith(_INPUT) else made)[path] = checksum
    return made, read


def _write(file: Path, made: Mapping[str, str], read: Mapping[str, str]) -> None:
    if made:
        lines = [f"{value}  {path}\n" for path, value in made.items()]
        write_text(file, "".join([*lines, *(f"{_INPUT}{v}  {path}\n" for path, v in read.items())]))
    else:
        file.unlink(missing_ok=True)


def _remove_lines(file: Path, folder: Path, paths: Collection[str]) -> None:
    """Remove the lines about given files, and any other line that is not right. Two jobs may do
    this to one file at the same time. Neither writes back a line that the other one removes: the
    outputs of a job do not exist until it has made them, and then differ."""
    made, read = _read(file)
    if not made.keys().isdisjoint(paths):
        kept = {
            path: checksum
            for path, checksum in made.items()
            if path not in paths and _is_right(folder / path, checksum)
        }
        _write(file, kept, read)


def _is_right(file: Path, checksum: str | None) -> bool:
    try:
        return sha256_of_file(file) == checksum
    except OSError:
        return False
