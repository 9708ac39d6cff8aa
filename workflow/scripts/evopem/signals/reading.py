"""One recording out of a measured file, whatever its format."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import os
import signal
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.signals.readers.channels import Channel, Reference, refuse_unreadable
from evopem.signals.recording import Recording, check_recording, describe_recording
from evopem.signals.timestamps import sampling_rate_of

FORMATS = {
    ".csv": "text",
    ".tsv": "text",
    ".txt": "text",
    ".dat": "text",
    ".asc": "text",
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
"""The readers whose libraries parse a file in compiled code."""

LARGEST_STUCK_SHARE = 0.9
"""An output with more than this share of its samples at one value, or at its two limits, is
refused; less is left to the report to judge."""

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
    input: Reference,  # noqa: A002
    output: Reference,
    sampling_rate: float | None = None,
    time: Reference | None = None,
    input_unit: str = "",
    output_unit: str = "",
) -> Recording:
    """Read an input and an output channel of a measured file.

    Parameters
    ----------
    path : str or Path
        A file of one of `FORMATS`; the extension decides.
    input, output : int or str
        The channels: a number counted from 1, or a column, variable or channel name.
    sampling_rate : float, optional
        Hz. Left out, it is taken from `time`, else from the file where its format states one.
    time : int or str, optional
        Channel of time stamps, which must be uniform (see `sampling_rate_of`).
    input_unit, output_unit : str, optional
        Units; left out, those that the file states.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        When the file cannot be read as its format, a channel is not there or not a signal
        of finite numbers, or the sampling rate is unknown or contradicted by the time stamps.
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
    references = [input, output] if time is None else [input, output, time]
    channels = _read_channels(path, references)
    signals = [_signal(channels[0], "input", source), _signal(channels[1], "output", source)]
    if signals[0].size != signals[1].size:
        raise InputError(
            source,
            f"the input has {signals[0].size} samples and the output {signals[1].size}",
            "choose two channels that were sampled together",
        )
    recording = Recording(
        input=signals[0],
        output=signals[1],
        sampling_rate=_sampling_rate(channels, sampling_rate, source),
        input_name=channels[0].name or "input",
        output_name=channels[1].name or "output",
        input_unit=input_unit or channels[0].unit,
        output_unit=output_unit or channels[1].unit,
    )
    check_recording(recording, source)
    _refuse_stuck(recording, source)
    return recording


def describe_source(
    path: str | Path,
    recording: Recording,
    input: Reference,  # noqa: A002
    output: Reference,
) -> dict[str, Any]:
    """Where a recording came from, for its provenance.

    Parameters
    ----------
    path : str or Path
        The file it was read from.
    recording : Recording
        What was read.
    input, output : int or str
        The channels as they were asked for.

    Returns
    -------
    dict
        ``kind`` ("file"), ``path``, ``sha256``, ``bytes``, ``format``, ``input_channel``,
        ``output_channel``, and what `describe_recording` says.
    """
    path = Path(path)
    return {
        "kind": "file",
        "path": str(path),
        "sha256": sha256(path),
        "bytes": path.stat().st_size,
        "format": format_of(path),
        "input_channel": input,
        "output_channel": output,
        **describe_recording(recording),
    }


def sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes, as hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def format_of(path: Path) -> str:
    extension = path.suffix.lower()
    if extension not in FORMATS:
        raise InputError(
            str(path),
            f'the extension "{extension}" is none of a known format',
            f"use one of {' '.join(FORMATS)}",
        )
    return FORMATS[extension]


def _read_channels(path: Path, references: list[Reference]) -> list[Channel]:
    format_name = format_of(path)
    if not path.exists():
        raise InputError(str(path), "there is no such file", "check the path in the configuration")
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
    reader = importlib.import_module(f"evopem.signals.readers.{format_name}")
    if format_name in COMPILED and hasattr(os, "fork"):
        _refuse_deadly(reader, path, references)
    channels: list[Channel] = reader.read(path, references)
    return channels


def _refuse_deadly(reader: ModuleType, path: Path, references: list[Reference]) -> None:
    """Refuse a file that crashes its reader, by reading it first in a process of its own.

    A damaged file can make compiled code read past its memory, as scipy's reader of MATLAB files
    does, which no exception reports.
    """
    with warnings.catch_warnings():
        # From Python 3.12 on, a fork beside the idle threads of a BLAS is warned about.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        for deadly in (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGFPE):
            signal.signal(deadly, signal.SIG_DFL)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        with contextlib.suppress(BaseException):
            reader.read(path, references)
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


def _refuse_stuck(recording: Recording, source: str) -> None:
    """Refuse an output that hardly ever moves; an input of two levels is a good excitation."""
    output = recording.output
    values, counts = np.unique(output, return_counts=True)
    at_limits = np.count_nonzero((output == values[0]) | (output == values[-1])) / output.size
    usual = int(np.argmax(counts))
    for share, where in (
        (counts[usual] / output.size, f"are the same value, {values[usual]:g}"),
        (at_limits, f"lie at its smallest or largest value, {values[0]:g} or {values[-1]:g}"),
    ):
        if share > LARGEST_STUCK_SHARE:
            raise InputError(
                source,
                f"{100 * share:.1f} % of its samples {where}, so the channel was saturated, cut off"
                " or hardly ever moved",
                "record again within the range of the instrument, or cut that part away",
                f'output "{recording.output_name}"',
            )


def _sampling_rate(channels: list[Channel], stated: float | None, source: str) -> float:
    """The rate that is stated, else that of the time stamps, else the file's own."""
    in_file = {channel.sampling_rate for channel in channels[:2]}
    if len(in_file) > 1 and stated is None:
        rates = " and ".join("none" if one is None else f"{one:g} Hz" for one in in_file)
        raise InputError(
            source,
            f"the file states different sampling rates for input and output ({rates})",
            "choose two channels that were sampled together",
        )
    own = next(iter(in_file)) if len(in_file) == 1 else None
    if len(channels) == 3:
        clock = channels[2]
        if clock.values.size != channels[0].values.size:
            raise InputError(
                source,
                f"there are {clock.values.size} time stamps and {channels[0].values.size} samples",
                "choose the time channel of these signals",
                f'time "{clock.name}"',
            )
        known = stated if stated is not None else own
        return sampling_rate_of(clock.values, source, clock.name, clock.unit, known)
    if stated is not None:
        return float(stated)
    if own is not None:
        return own
    raise InputError(
        source,
        "the sampling rate is not known, since the file states none",
        "give sampling_rate in Hz or the name of a time channel",
    )
