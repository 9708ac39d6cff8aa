"""Files of the known formats: what reads them, and channels as a file holds them."""

import contextlib
import importlib
import os
import signal
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

from evopem.errors import InputError
from evopem.signals.readers.open_file import Channel, Contents, Reference, refuse_unreadable

T = TypeVar("T")


class _Format(NamedTuple):
    """A format, whose reader is a module of `evopem.signals.readers`."""

    label: str
    extensions: str
    beginnings: tuple[bytes, ...] = ()  # with which its files begin
    # Its library parses a file in compiled code, which a damaged file can crash.
    is_compiled: bool = False


_HDF5 = b"\x89HDF\r\n\x1a\n"
_READERS = {
    "text": _Format("text", ".csv .tsv .txt .dat .asc .lvm"),
    "hdf5": _Format("HDF5", ".h5 .hdf5", (_HDF5,), True),
    "matlab": _Format("MATLAB", ".mat", (b"MATLAB", _HDF5), True),
    "numpy_files": _Format("zip, npz or npy", ".npz .npy", (b"PK\x03\x04", b"\x93NUMPY")),
    "parquet": _Format("Parquet", ".parquet", (b"PAR1",), True),
    "tdms": _Format("TDMS", ".tdms", (b"TDSm",)),
    "uff": _Format("a universal file", ".uff .unv"),
    "wav": _Format("WAV", ".wav", (b"RIFF", b"RIFX", b"RF64")),
    "mdf": _Format("MDF", ".mf4 .mdf", (b"MDF     ",), True),
}
FORMATS = {end: name for name, reader in _READERS.items() for end in reader.extensions.split()}
"""The name of the format of each extension."""


def channel_names(path: str | Path) -> list[str]:
    """Names of all channels of a measured file, in the order of their numbers.

    A channel without a name has an empty one.
    """
    return _read(Path(path), {}, lambda contents: contents.listed)


def read_channels(
    path: str | Path,
    references: Sequence[Reference],
    header_lines: int | None = None,
    decimal_mark: str | None = None,
) -> list[Channel]:
    """Read channels of a measured file as the file holds them, without any check of their values.

    ``header_lines`` and ``decimal_mark`` are those of a text table, where they are stated.
    """
    path = Path(path)
    stated = {"header_lines": header_lines, "decimal_mark": decimal_mark}
    options: dict[str, Any] = {key: value for key, value in stated.items() if value is not None}
    if options and format_of(path) != "text":
        problem = f"{next(iter(options))} is stated for a file that is no text table"
        raise InputError(str(path), problem, "remove it")
    if format_of(path) == "text":
        options["references"] = references
    return _read(path, options, lambda contents: contents.read(references))


def format_of(path: Path) -> str:
    """The format of a file, one of the values of `FORMATS`, by its extension."""
    extension = path.suffix.lower()
    if extension not in FORMATS:
        problem = f'the extension "{extension}" is none of a known format'
        raise InputError(str(path), problem, f"use one of {' '.join(FORMATS)}")
    return FORMATS[extension]


def local_path(path: Path) -> Path:
    """The path as the operating system's calls take it; in the C locale as UTF-8."""
    try:
        os.fsencode(path)
    except UnicodeEncodeError:
        return Path(os.fsdecode(str(path).encode("utf-8", "surrogateescape")))
    return path


def _read(path: Path, options: dict[str, Any], use: Callable[[Contents], T]) -> T:
    """Use the contents of a file, which is opened by its path as the system's calls take it."""
    local = local_path(path)

    def opened() -> T:
        with reader.opened(local, **options) as contents:
            return use(contents)

    try:
        reader = _reader_of(local)
        if _READERS[format_of(local)].is_compiled and hasattr(os, "fork"):
            _refuse_crashing(opened, local)
        return opened()
    except InputError as refused:
        if local == path or refused.source != str(local):
            raise
        raise InputError(str(path), refused.problem, refused.remedy, refused.place) from None


def _reader_of(path: Path) -> ModuleType:
    """The module that reads a file, which must be there and be what its extension says."""
    format_name = format_of(path)
    try:
        path.stat()
    except (OSError, ValueError):
        # Also a name that is too long for the file system, or that holds a zero byte.
        raise InputError(str(path), "there is no such file", "check the path") from None
    if not path.is_file():
        raise InputError(str(path), "is not a file", "give the path of one file")
    try:
        with path.open("rb") as file:
            beginning = file.read(8)
    except OSError as error:
        problem = f"cannot be opened ({error.strerror})"
        raise InputError(str(path), problem, "check its permissions") from None
    if not beginning:
        raise InputError(str(path), "the file is empty", "export or copy it again")
    readers = [name for name, reader in _READERS.items() if beginning.startswith(reader.beginnings)]
    if readers and format_name not in readers:
        problem = f"its content is {_READERS[readers[0]].label}, which the extension does not say"
        raise InputError(str(path), problem, "give the file the extension of its format")
    return importlib.import_module(f"evopem.signals.readers.{format_name}")


def _refuse_crashing(opened: Callable[[], object], path: Path) -> None:
    """Refuse a file that crashes its reader, by reading it first in a separate process. A damaged
    file can make compiled code access invalid memory, which ends the process."""
    with warnings.catch_warnings():
        # From Python 3.12 on, a fork beside the idle threads of a BLAS is warned about.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        for fatal in (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGFPE):
            signal.signal(fatal, signal.SIG_DFL)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        with contextlib.suppress(BaseException):
            opened()
        os._exit(0)
    if os.waitpid(child, 0)[1] != 0:
        refuse_unreadable(path, f"{_READERS[format_of(path)].label} file")
