"""The signals that a user hands over: columns of a table, series or arrays, and their rate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.files.npz import save_arrays
from evopem.signals.timestamps import RATE_TOLERANCE, sampling_rate_of

if TYPE_CHECKING:
    import pandas as pd

DATA = "data"
"""What an error calls the first argument of :func:`evopem.identify`."""

# Names that numpy's own arguments have.
_NOT_A_NAME = ("", "file", "allow_pickle")


@dataclass(frozen=True, eq=False)
class GivenSignals:
    """An input and an output as they were handed over.

    Attributes
    ----------
    input : ndarray of float64, shape (N,), optional
        None for an output alone.
    output : ndarray of float64, shape (N,)
    sampling_rate : float, optional
        Hz; None where neither the user nor an index states it.
    input_name, output_name : str
        Different ones.
    """

    input: NDArray[np.float64] | None
    output: NDArray[np.float64]
    sampling_rate: float | None
    input_name: str
    output_name: str

    def save(self, path: Path) -> None:
        """Write the signals as a recorded file, under their names."""
        arrays = {self.output_name: self.output}
        if self.input is not None:
            arrays = {self.input_name: self.input} | arrays
        save_arrays(path, arrays)


def given_signals(
    data: Any,
    output: Any,
    input: Any = None,  # noqa: A002 - the field's word
    time: Any = None,
    sampling_rate: float | None = None,
    source: str = DATA,
) -> GivenSignals:
    """Take two signals and their rate from what a user hands over.

    Parameters
    ----------
    data : pandas.DataFrame, pandas.Series, array_like or None
        A table; or the samples of the input, where ``output`` holds those of the output.
    output : column label, pandas.Series or array_like
    input, time : column label, optional
        Of a table alone.
    sampling_rate : float, optional
        Hz. Left out, it is that of `time` or of an index of times.
    source : str
        What an error calls the data.

    Raises
    ------
    InputError
        When a column is not there or named twice, a signal holds no numbers, or no rate is known.
    """
    if _is_table(data):
        return _of_table(data, output, input, time, sampling_rate, source)
    for name, label in (("input", input), ("time", time)):
        if label is not None:
            raise InputError(
                name,
                "it names a column, and the data are no table",
                "give a pandas DataFrame, or the samples of input and output alone",
            )
    signals = [each for each in (data, output) if each is not None]
    index = next((each.index for each in signals if hasattr(each, "index")), None)
    samples = None if data is None else _samples(data, source, "input")
    return GivenSignals(
        samples,
        _samples(output, source, "output"),
        _rate(index, sampling_rate, source),
        *_names(getattr(data, "name", None), getattr(output, "name", None)),
    )


def given_recordings(
    data: Any,
    output: Any,
    input: Any = None,  # noqa: A002 - the field's word
    time: Any = None,
    sampling_rate: float | None = None,
    source: str = DATA,
) -> tuple[GivenSignals, ...]:
    """The signals of one recording, or of each of several that are one data set.

    Parameters
    ----------
    data, output, input, time, sampling_rate, source
        As for :func:`given_signals`; several recordings are a list of tables, or lists of the
        signals of each.

    Raises
    ------
    InputError
        As :func:`given_signals` does, and when the recordings differ in rate or have an input in
        part.
    """
    if not _are_several(data) and not (data is None and _are_several(output)):
        return (given_signals(data, output, input, time, sampling_rate, source),)
    several = list(output if data is None else data)
    if _is_table(several[0]):
        outputs: list[Any] = [output] * len(several)
    else:
        outputs = list(output) if _are_several(output) else []
        several = [None] * len(outputs) if data is None else several
    if len(outputs) != len(several):
        raise InputError(
            source,
            f"there are {len(several)} inputs and {len(outputs) or 'no'} outputs",
            "give a list of the input and of the output of each recording",
        )
    found = tuple(
        given_signals(each, own, input, time, sampling_rate, f"{source}, recording {number}")
        for number, (each, own) in enumerate(zip(several, outputs, strict=True), start=1)
    )
    return tuple(alike(each, found[0], source) for each in found)


def alike(signals: GivenSignals, first: GivenSignals, source: str) -> GivenSignals:
    """The signals of a further recording, under the names of the first one.

    Raises
    ------
    InputError
        When the two differ in rate, or one of them has no input.
    """
    rate, other = first.sampling_rate, signals.sampling_rate
    if rate and other and abs(other / rate - 1.0) > RATE_TOLERANCE:
        raise InputError(
            source,
            f"a sampling rate is {other:g} Hz, and that of the first recording is {rate:g} Hz",
            "give recordings of one rate",
        )
    if (signals.input is None) != (first.input is None):
        raise InputError(source, "one of the recordings has no input", "give all an input, or none")
    return replace(signals, input_name=first.input_name, output_name=first.output_name)


def _are_several(data: Any) -> bool:
    """Whether a list holds recordings, and not the samples of one."""
    if not isinstance(data, list | tuple) or not data:
        return False
    return _is_table(data[0]) or np.ndim(data[0]) > 0


def _of_table(
    table: pd.DataFrame,
    output: Any,
    input: Any,  # noqa: A002
    time: Any,
    sampling_rate: float | None,
    source: str,
) -> GivenSignals:
    columns = {"input": input, "output": output, "time": time}
    found = {
        role: _column(table, label, role, source)
        for role, label in columns.items()
        if label is not None
    }
    if "output" not in found:
        raise InputError("output", "it is missing", f"give one of {_listed(table)}")
    if input is not None and input == output:
        raise InputError(
            "output", f"column {input!r} is the input as well", "choose two different columns"
        )
    if "time" in found:
        stamps = np.asarray(found["time"])
        rate: float | None = sampling_rate_of(stamps, source, str(time), stated_rate=sampling_rate)
    else:
        rate = _rate(table.index, sampling_rate, source)
    samples = _samples(found["input"], source, "input") if "input" in found else None
    return GivenSignals(
        samples, _samples(found["output"], source, "output"), rate, *_names(input, output)
    )


def _is_table(data: Any) -> bool:
    return hasattr(data, "columns") and hasattr(data, "iloc")


def _column(table: pd.DataFrame, label: Any, role: str, source: str) -> Any:
    try:
        places = int(np.count_nonzero(np.asarray(table.columns == label)))
    except (TypeError, ValueError):
        places = 0
    if places == 1:
        return table[label]
    if places:
        raise InputError(
            source, f"{places} columns are called {label!r}", "give each its own name", role
        )
    raise InputError(
        source, f"there is no column {label!r}", f"choose one of {_listed(table)}", role
    )


def _listed(table: pd.DataFrame, most: int = 20) -> str:
    names = [repr(label) for label in table.columns[:most]]
    left = len(table.columns) - len(names)
    return ", ".join([*names, *([f"… and {left} more"] if left else [])])


def _samples(values: Any, source: str, role: str) -> NDArray[np.float64]:
    """A copy of a signal's samples as numbers."""
    array = np.asarray(values)
    if array.ndim == 2 and 1 in array.shape:
        array = array.ravel()
    if array.dtype.kind not in "fiubO":
        raise InputError(source, "it holds no real numbers", "choose another signal", role)
    try:
        # A table's missing values become NaN, which the checks of a recording name.
        given = values.to_numpy(dtype=float, na_value=np.nan) if hasattr(values, "array") else array
        samples = np.array(given, dtype=float).reshape(array.shape)
    except (TypeError, ValueError):
        raise InputError(
            source, "it holds no real numbers", "choose another signal", role
        ) from None
    if samples.ndim != 1:
        raise InputError(
            source,
            f"the signal has {samples.ndim} dimensions where one is needed",
            "give a single signal",
            role,
        )
    return samples


def _rate(index: Any, stated: float | None, source: str) -> float | None:
    """The stated rate, checked against an index of dates; else that of an index of times."""
    stamps = None if index is None else np.asarray(index)
    if stamps is None or stamps.ndim != 1:
        return stated
    name = "index" if getattr(index, "name", None) is None else str(index.name)
    if stamps.dtype.kind in "Mm" or hasattr(index, "tz"):
        dates = index.tz_convert(None) if getattr(index, "tz", None) is not None else index
        return sampling_rate_of(np.asarray(dates), source, name, stated_rate=stated)
    if stated is None and stamps.dtype.kind == "f":
        return sampling_rate_of(stamps, source, name, time_unit="s")
    return stated


def _names(first: Any, second: Any) -> tuple[str, str]:
    """Names of input and output, those of their roles where they cannot be told apart."""
    names = [_name(label, role) for label, role in ((first, "input"), (second, "output"))]
    return ("input", "output") if names[0] == names[1] else (names[0], names[1])


def _name(label: Any, role: str) -> str:
    name = "" if label is None else str(label).strip(" :")
    return role if name in _NOT_A_NAME or not name.isprintable() else name
