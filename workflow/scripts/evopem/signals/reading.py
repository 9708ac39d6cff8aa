"""Read a recording from a measured file of any known format."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import itertools
import os
import signal
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import ChannelSettings, UnevenTime
from evopem.config.state_space_settings import ChannelLists
from evopem.errors import InputError
from evopem.signals.even_grid import Unevenness, even_grid
from evopem.signals.readers.channels import Channel, Reference, refuse_unreadable
from evopem.signals.recording import (
    Recording,
    check_measured,
    check_recording,
    without_input,
)
from evopem.signals.timestamps import is_time, names_time, sampling_rate_of

T = TypeVar("T")

FORMATS = {
    ".csv": "text",
    ".tsv": "text",
    ".txt": "text",
    ".dat": "text",
    ".asc": "text",
    ".lvm": "text",
    ".mat": "matlab",
    ".npz": "numpy_files",
    ".npy": "numpy_files",
    ".parquet": "parquet",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".tdms": "tdms",
    ".uff": "uff",
    ".unv": "uff",
}
"""The module of `evopem.signals.readers` that reads each extension."""

COMPILED = {"matlab": "MATLAB", "hdf5": "HDF5", "parquet": "Parquet"}
"""The readers whose libraries parse a file in compiled code, which a damaged file can crash."""

_SIGNATURES = {
    b"PAR1": ("Parquet", ("parquet",)),
    b"\x89HDF\r\n\x1a\n": ("HDF5", ("hdf5", "matlab")),
    b"PK\x03\x04": ("zip or npz", ("numpy_files",)),
    b"\x93NUMPY": ("npy", ("numpy_files",)),
    b"TDSm": ("TDMS", ("tdms",)),
    b"MATLAB": ("MATLAB", ("matlab",)),
}


def read_recording(
    path: str | Path,
    input: Reference | None,  # noqa: A002
    output: Reference,
    sampling_rate: float | None = None,
    time: Reference | None = None,
    input_unit: str = "",
    output_unit: str = "",
    time_unit: str | None = None,
    header_lines: int | None = None,
    decimal_mark: str | None = None,
    uneven_time: UnevenTime = "refuse",
) -> Recording:
    """Read an input and an output channel of a measured file.

    Parameters
    ----------
    path : str or Path
        A file of one of `FORMATS`; the extension decides.
    input, output : int or str
        The channels: a number counted from 1, or a column, variable or channel name.  Without an
        input, None.
    sampling_rate : float, optional
        Hz. Left out, it is taken from `time`, else from the file where its format states one.
    time : int or str, optional
        Channel of time stamps, which must be uniform (see `sampling_rate_of`).
    input_unit, output_unit : str, optional
        Units; left out, those that the file states.
    time_unit : str, optional
        Unit of the time stamps, one of `TIME_UNITS`; left out, the one that the file states.
    header_lines : int, optional
        Of a text table, the number of lines above the first row of numbers.
    decimal_mark : str, optional
        Of a text table, "." or ",".
    uneven_time : {"refuse", "interpolate"}
        What is done with time stamps that are not uniform: signals may be brought to an even grid
        (:func:`.even_grid`).

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        When the file cannot be read as its format; a channel is not there or not a signal
        of finite numbers; input, output and time are not three different signals; or the
        sampling rate is unknown or contradicted by the time stamps.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "data.csv"
    ...     samples = [f"{i / 100},{i % 3},{i % 5}" for i in range(10)]
    ...     _ = file.write_text("\\n".join(["time,u,y", *samples]))
    ...     recording = read_recording(file, "u", "y", time="time")
    >>> recording.sampling_rate, recording.output
    (100.0, array([0., 1., 2., 3., 4., 0., 1., 2., 3., 4.]))
    """
    path = Path(path)
    source = str(path)
    if sampling_rate is not None and not (np.isfinite(sampling_rate) and sampling_rate > 0):
        raise InputError(
            source, f"{sampling_rate} Hz is not a sampling rate", "give a positive number of Hz"
        )
    if input == output:
        raise InputError(
            source,
            f"channel {input!r} is named as the input and as the output",
            "choose two different channels",
        )
    options = _text_options(format_of(path), source, header_lines, decimal_mark)
    wanted = {"input": input, "output": output, "time": time}
    references = {role: each for role, each in wanted.items() if each is not None}
    found = _read_as(path, list(references.values()), options)
    channels = dict(zip(references, found, strict=True))
    signals = {role: _signal(channels[role], role, source) for role in channels if role != "time"}
    if input is not None and signals["input"].size != signals["output"].size:
        raise InputError(
            source,
            f"the input has {signals['input'].size} samples and the output"
            f" {signals['output'].size}",
            "choose two channels that were sampled together",
        )
    _refuse_same(channels, references, source)
    signals, rate = _sampled(signals, channels, sampling_rate, time_unit, uneven_time, source)
    recording = without_input(
        signals["output"],
        rate,
        channels["output"].name or "output",
        output_unit or channels["output"].unit,
    )
    if input is not None:
        _refuse_other_start([channels["input"], channels["output"]], rate, source)
        recording = replace(
            recording,
            input=signals["input"],
            input_name=channels["input"].name or "input",
            input_unit=input_unit or channels["input"].unit,
        )
    check_recording(recording, source)
    check_measured(recording, source)
    for role in signals:
        if is_time(getattr(recording, role), rate):
            raise InputError(
                source,
                "the channel increases by the sampling period in every sample, as a time does",
                "choose another channel",
                f'{role} "{getattr(recording, f"{role}_name")}"',
            )
    return recording


def read_columns(
    path: str | Path,
    references: Mapping[str, Reference],
    sampling_rate: float | None = None,
    time_unit: str | None = None,
    header_lines: int | None = None,
    decimal_mark: str | None = None,
    uneven_time: UnevenTime = "refuse",
) -> tuple[dict[str, Channel], float]:
    """Read any number of channels that were sampled together, with their sampling rate.

    Parameters
    ----------
    path : str or Path
    references : mapping of str to int or str
        Channels by what an error calls them, such as ``output 2``.  ``time`` is that of the time
        stamps.
    sampling_rate, time_unit, header_lines, decimal_mark, uneven_time : optional
        As of :func:`read_recording`.

    Returns
    -------
    channels : dict of str to Channel
        Without the time stamps; values are float64.
    sampling_rate : float
        Hz.

    Raises
    ------
    InputError
        As :func:`read_recording`.
    """
    path = Path(path)
    source = str(path)
    options = _text_options(format_of(path), source, header_lines, decimal_mark)
    found = _read_as(path, list(references.values()), options)
    channels = dict(zip(references, found, strict=True))
    values = {role: _signal(channels[role], role, source) for role in channels if role != "time"}
    first = next(iter(values))
    for role, each in values.items():
        if each.size != values[first].size:
            raise InputError(
                source,
                f"the {first} has {values[first].size} samples and the {role} {each.size}",
                "choose channels that were sampled together",
            )
    _refuse_same(channels, dict(references), source)
    values, rate = _sampled(values, channels, sampling_rate, time_unit, uneven_time, source)
    signals = {role: replace(channels[role], values=each) for role, each in values.items()}
    for channel in signals.values():
        _refuse_other_start([signals[first], channel], rate, source)
    return signals, rate


def uneven_times(
    paths: Sequence[str | Path], channels: Sequence[ChannelSettings | ChannelLists]
) -> tuple[Unevenness, ...]:
    """How uneven the time stamps of some files are; empty where they have to be uniform.

    Parameters
    ----------
    paths : sequence of str or Path
    channels : sequence of ChannelSettings or ChannelLists
        Of each file.

    Raises
    ------
    InputError
        As :func:`read_recording`.
    """
    found = []
    for path, own in zip(map(Path, paths), channels, strict=True):
        if own.uneven_time == "refuse" or own.time is None:
            continue
        options = _text_options(format_of(path), str(path), own.header_lines, own.decimal_mark)
        (time,) = _read_as(path, [own.time], options)
        found.append(even_grid(time.values, str(path), time.name).unevenness)
    return tuple(found)


def channel_names(path: str | Path) -> list[str]:
    """Names of all channels of a measured file, in the order of their numbers.

    A channel without a name has an empty one.

    Raises
    ------
    InputError
        When the file cannot be read as its format.
    """
    return _read(Path(path), lambda reader, local: reader.names(local))


def read_channels(path: str | Path, references: Sequence[Reference]) -> list[Channel]:
    """Read channels of a measured file as the file holds them, without any check of their values.

    Raises
    ------
    InputError
        When the file cannot be read as its format, or there is no such channel.
    """
    return _read(Path(path), lambda reader, local: reader.read(local, references))


def sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes, as hexadecimal digits."""
    with local_path(Path(path)).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def format_of(path: Path) -> str:
    """The format of a file, one of the values of `FORMATS`, by its extension.

    Raises
    ------
    InputError
        When the extension is not known.
    """
    extension = path.suffix.lower()
    if extension not in FORMATS:
        raise InputError(
            str(path),
            f'the extension "{extension}" is none of a known format',
            f"use one of {' '.join(FORMATS)}",
        )
    return FORMATS[extension]


def local_path(path: Path) -> Path:
    """The path as the operating system's calls take it in any locale.

    In the C locale without UTF-8 mode Python cannot encode a name such as "Größe.csv". Files are
    then named by the bytes of UTF-8.
    """
    try:
        os.fsencode(path)
    except UnicodeEncodeError:
        return Path(os.fsdecode(str(path).encode("utf-8", "surrogateescape")))
    return path


def _text_options(
    format_name: str, source: str, header_lines: int | None, decimal_mark: str | None
) -> dict[str, Any]:
    """The options that are given, which must fit the format."""
    stated = {"header_lines": header_lines, "decimal_mark": decimal_mark}
    options = {key: value for key, value in stated.items() if value is not None}
    if options and format_name != "text":
        raise InputError(
            source, f"{next(iter(options))} is stated for a file that is no text table", "remove it"
        )
    if header_lines is not None and header_lines < 0:
        raise InputError(source, f"header_lines is {header_lines}", "give 0 or a number above")
    if decimal_mark not in (None, ".", ","):
        raise InputError(source, f'the decimal mark is "{decimal_mark}"', 'give "." or ","')
    return options


def _read_as(path: Path, references: Sequence[Reference], options: dict[str, Any]) -> list[Channel]:
    """Channels of a file, by the stated form of a text table."""
    return _read(path, lambda reader, local: reader.read(local, list(references), **options))


def _read(path: Path, use: Callable[[ModuleType, Path], T]) -> T:
    """Call a function with the reader of a file and the path as the system's calls take it."""
    local = local_path(path)
    try:
        reader = _reader_of(local)
        if format_of(local) in COMPILED and hasattr(os, "fork"):
            _refuse_crashing(reader, local, use)
        return use(reader, local)
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
        raise InputError(
            str(path), "there is no such file", "check the path in the configuration"
        ) from None
    if not path.is_file():
        raise InputError(str(path), "is not a file", "give the path of one file")
    try:
        with path.open("rb") as file:
            beginning = file.read(8)
    except OSError as error:
        raise InputError(
            str(path), f"cannot be opened ({error.strerror})", "check its permissions"
        ) from None
    if not beginning:
        raise InputError(str(path), "the file is empty", "export or copy it again")
    for signature, (label, formats) in _SIGNATURES.items():
        if beginning.startswith(signature) and format_name not in formats:
            raise InputError(
                str(path),
                f"its content is {label}, which the extension does not say",
                "give the file the extension of its format",
            )
    return importlib.import_module(f"evopem.signals.readers.{format_name}")


def _refuse_crashing(
    reader: ModuleType, path: Path, use: Callable[[ModuleType, Path], object]
) -> None:
    """Refuse a file that crashes its reader, by reading it first in a separate process.

    A damaged file can make compiled code access invalid memory, as in scipy's reader of MATLAB
    files. That ends the process without an exception.
    """
    with warnings.catch_warnings():
        # From Python 3.12 on, a fork beside the idle threads of a BLAS is warned about.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        for fatal in (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGFPE):
            signal.signal(fatal, signal.SIG_DFL)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        with contextlib.suppress(BaseException):
            use(reader, path)
        os._exit(0)
    if os.waitpid(child, 0)[1] != 0:
        refuse_unreadable(path, f"{COMPILED[reader.__name__.rpartition('.')[2]]} file")


def _signal(channel: Channel, role: str, source: str) -> NDArray[np.float64]:
    """The samples of an input or output channel as real numbers."""
    if channel.values.dtype.kind not in "fiub":
        kinds = {"c": "complex numbers", "M": "dates"}
        raise InputError(
            source,
            f"the channel holds {kinds.get(channel.values.dtype.kind, 'text or objects')},"
            " not real numbers",
            "choose another channel",
            f'{role} "{channel.name}"' if channel.name else role,
        )
    return channel.values.astype(np.float64)


def _refuse_same(
    channels: dict[str, Channel], references: dict[str, Reference], source: str
) -> None:
    """Refuse an input, an output and a time of which two hold the same values."""
    for one, other in itertools.combinations(channels, 2):
        first, second = channels[one].values, channels[other].values
        if np.array_equal(first, second):
            raise InputError(
                source,
                f"the {one} ({references[one]!r}) and the {other}"
                f" ({references[other]!r}) hold the same values",
                "choose different channels",
            )


def _refuse_other_start(channels: list[Channel], rate: float, source: str) -> None:
    """Refuse an input and an output that begin at different times."""
    starts = [channel.start for channel in channels if channel.start is not None]
    # A date in seconds since 1970 has a resolution of less than a microsecond as a float.
    if len(starts) == 2 and abs(starts[1] - starts[0]) > max(0.5 / rate, 1e-6):
        raise InputError(
            source,
            f"the output begins {starts[1] - starts[0]:g} s after the input",
            "choose two channels that were sampled together",
        )


def _sampled(
    signals: dict[str, NDArray[np.float64]],
    channels: dict[str, Channel],
    stated_rate: float | None,
    time_unit: str | None,
    uneven_time: UnevenTime,
    source: str,
) -> tuple[dict[str, NDArray[np.float64]], float]:
    """The signals at a constant rate, and the rate."""
    if uneven_time == "refuse":
        return signals, _sampling_rate(channels, stated_rate, time_unit, source)
    if "time" not in channels:
        raise InputError(
            source,
            "uneven_time is stated without a time channel",
            f"state time{_named_times(source)}, or remove uneven_time",
        )
    time = channels["time"]
    grid = even_grid(time.values, source, time.name)
    rate = _sampling_rate(channels, stated_rate, time_unit, source, grid.step)
    return {role: grid.interpolated(each) for role, each in signals.items()}, rate


def _sampling_rate(
    channels: dict[str, Channel],
    stated: float | None,
    time_unit: str | None,
    source: str,
    step: float | None = None,
) -> float:
    """The rate that is stated, else that of the time stamps, else the file's own.

    That of the time stamps follows from their mean step where they are not uniform.
    """
    signals = [channel for role, channel in channels.items() if role != "time"]
    in_file = list(dict.fromkeys(channel.sampling_rate for channel in signals))
    if len(in_file) > 1 and stated is None:
        rates = " and ".join("none" if one is None else f"{one:g} Hz" for one in in_file)
        raise InputError(
            source,
            f"the file states different sampling rates for input and output ({rates})",
            "choose two channels that were sampled together",
        )
    own = in_file[0] if len(in_file) == 1 else None
    if "time" in channels:
        time = channels["time"]
        if time.values.size != signals[0].values.size:
            raise InputError(
                source,
                f"there are {time.values.size} time stamps and {signals[0].values.size} samples",
                "choose the time channel of these signals",
                f'time "{time.name}"',
            )
        known = stated if stated is not None else own
        stamps = time.values, source, time.name, time.unit
        return sampling_rate_of(*stamps, known, time_unit, step)
    if time_unit is not None:
        raise InputError(
            source, "time_unit is stated without a time channel", "remove it or state time"
        )
    if stated is not None:
        return float(stated)
    if own is not None:
        return own
    problem = next((one.rate_problem for one in signals if one.rate_problem), "")
    raise InputError(
        source,
        f"the sampling rate is not known, since {problem or 'the file states none'}",
        f"give sampling_rate in Hz or the name of a time channel{_named_times(source)}",
    )


def _named_times(path: str) -> str:
    """The first channel whose name says that it holds times, in words; empty where none does."""
    named = [name for name in channel_names(path) if names_time(name)]
    return f', such as "{named[0]}"' if named else ""
