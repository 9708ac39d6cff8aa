"""The signals that a user hands over: columns of tables, series or arrays, and their rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evopem.errors import InputError
from evopem.files.archive import save_arrays
from evopem.signals.timestamps import RATE_TOLERANCE, timing

DATA = "data"
"""What an error calls the first argument of :func:`evopem.identify`."""

# Names that numpy's own arguments have.
_NOT_A_NAME = ("", "file", "allow_pickle")


@dataclass(frozen=True, eq=False)
class GivenSignals:
    """Inputs and outputs as they were handed over."""

    inputs: NDArray[np.float64]  # no columns for outputs alone
    outputs: NDArray[np.float64]
    sampling_rate: float | None  # hz; None where neither the user nor an index states it
    input_names: tuple[str, ...]  # all different
    output_names: tuple[str, ...]

    def save(self, path: Path) -> None:
        """Write the signals as a recorded file, under their names."""
        names = (*self.input_names, *self.output_names)
        save_arrays(path, dict(zip(names, (*self.inputs.T, *self.outputs.T), strict=True)))


@dataclass(frozen=True)
class Wanted:
    """What a user says about the signals beside the data."""

    output: Any
    input: Any = None
    time: Any = None
    sampling_rate: Any = None  # hz
    time_unit: str | None = None  # unit of the times


def checked_rate(rate: Any) -> float | None:
    """A sampling rate as a number."""
    if rate is None:
        return None
    try:
        number = float(rate) if isinstance(rate, Real) and not isinstance(rate, bool) else np.nan
    except OverflowError:
        number = np.inf
    if not (np.isfinite(number) and number > 0.0):
        shown = repr(rate) if len(repr(rate)) < 40 else f"{repr(rate)[:37]}..."
        raise InputError("sampling_rate", f"{shown} is no rate", "give a positive number of Hz")
    return number


def given_signals(data: Any, wanted: Wanted, source: str = DATA) -> GivenSignals:
    """Take signals and their rate from what a user hands over.

    `data` is a table whose columns are named, or the samples of the inputs, (N,) or (N, m); those
    of the outputs are then in ``wanted.output``. `source` is what an error calls the data.
    """
    if _is_table(data) and not _has_samples(wanted.output):
        return _of_table(data, wanted, source)
    for name, label in (("input", wanted.input), ("time", wanted.time)):
        if label is not None:
            raise InputError(
                name,
                "it names a column, and the data are no table",
                "give a pandas DataFrame, or the samples of input and output alone",
            )
    if wanted.output is None:
        raise InputError("output", "it is missing", "give the samples of the output")
    indexes = [each.index for each in (data, wanted.output) if _has_index(each)]
    _check_alike(indexes, source)
    outputs = _samples(wanted.output, source, "output")
    inputs = np.empty((len(outputs), 0)) if data is None else _samples(data, source, "input")
    return GivenSignals(
        inputs,
        outputs,
        _rate(indexes[0] if indexes else None, wanted, source),
        *_names(_labels(data, inputs.shape[1]), _labels(wanted.output, outputs.shape[1])),
    )


def given_recordings(data: Any, wanted: Wanted, source: str = DATA) -> tuple[GivenSignals, ...]:
    """The signals of one recording, or of each of a list of them that are one data set."""
    output = wanted.output
    if not _are_several(data) and not (data is None and _are_several(output)):
        return (given_signals(data, wanted, source),)
    several = list(output if data is None else data)
    if _is_table(several[0]) and not _has_samples(output) and not _are_several(output):
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
        given_signals(each, replace(wanted, output=own), f"{source}, recording {number}")
        for number, (each, own) in enumerate(zip(several, outputs, strict=True), start=1)
    )
    return tuple(alike(each, found[0], source) for each in found)


def alike(signals: GivenSignals, first: GivenSignals, source: str) -> GivenSignals:
    """The signals of a further recording, under the names of the first one."""
    rate, other = first.sampling_rate, signals.sampling_rate
    if rate and other and abs(other / rate - 1.0) > RATE_TOLERANCE:
        raise InputError(
            source,
            f"a sampling rate is {other:g} Hz, and that of the first recording is {rate:g} Hz",
            "give recordings of one rate",
        )
    for role in ("inputs", "outputs"):
        own, expected = (getattr(each, role).shape[1] for each in (signals, first))
        if own != expected:
            raise InputError(
                source,
                f"a recording has {own} {role}, and the first one {expected}",
                "give recordings of the same channels",
            )
    return replace(signals, input_names=first.input_names, output_names=first.output_names)


def _are_several(data: Any) -> bool:
    """Whether a list holds recordings, and not the samples of one."""
    if not isinstance(data, list | tuple) or not data:
        return False
    return _is_table(data[0]) or np.ndim(data[0]) > 0


def _of_table(table: Any, wanted: Wanted, source: str) -> GivenSignals:
    inputs = _listed_labels(table, wanted.input)
    outputs = _listed_labels(table, wanted.output)
    if not outputs:
        raise InputError("output", "it is missing", f"give one of {_listed(table)}")
    columns = [_column(table, label, "input", source) for label in inputs]
    targets = [_column(table, label, "output", source) for label in outputs]
    for label in outputs:
        if any(label == each for each in inputs):
            raise InputError(
                "output", f"column {label!r} is the input as well", "choose two different columns"
            )
    if wanted.time is not None:
        stamps = np.asarray(_column(table, wanted.time, "time", source))
        rate: float | None = timing(
            stamps,
            source,
            str(wanted.time),
            stated_rate=checked_rate(wanted.sampling_rate),
            time_unit=wanted.time_unit,
        ).rate
    else:
        rate = _rate(table.index, wanted, source)
    stacked = [_samples(each, source, "input") for each in columns]
    return GivenSignals(
        np.hstack(stacked) if stacked else np.empty((len(table), 0)),
        np.hstack([_samples(each, source, "output") for each in targets]),
        rate,
        *_names(inputs, outputs),
    )


def _is_table(data: Any) -> bool:
    return hasattr(data, "columns") and hasattr(data, "iloc")


def _has_index(data: Any) -> bool:
    return hasattr(data, "iloc") and hasattr(data, "index")


def _has_samples(output: Any) -> bool:
    """Whether an argument holds samples, and no label of a column."""
    return hasattr(output, "iloc") or (isinstance(output, np.ndarray) and output.ndim > 0)


def _listed_labels(table: Any, labels: Any) -> list[Any]:
    """The labels of one or several columns; a tuple may be one label itself."""
    if labels is None:
        return []
    if isinstance(labels, tuple) and _places(table, labels):
        return [labels]
    return list(labels) if isinstance(labels, list | tuple) else [labels]


def _places(table: Any, label: Any) -> int:
    """How many columns have a label; a truth value is none, though it equals a number."""
    if isinstance(label, bool | np.bool_):
        return 0
    try:
        return sum(1 for each in table.columns if each == label)
    except (TypeError, ValueError):
        return 0


def _column(table: Any, label: Any, role: str, source: str) -> Any:
    places = _places(table, label)
    if places == 1:
        return table[label]
    if places:
        raise InputError(
            source, f"{places} columns are called {label!r}", "give each its own name", role
        )
    raise InputError(
        source, f"there is no column {label!r}", f"choose one of {_listed(table)}", role
    )


def _listed(table: Any, most: int = 20) -> str:
    names = [repr(label) for label in table.columns[:most]]
    left = len(table.columns) - len(names)
    return ", ".join([*names, *([f"… and {left} more"] if left else [])])


def _samples(values: Any, source: str, role: str) -> NDArray[np.float64]:
    """A copy of signals as numbers, shape (N, channels); masked samples become NaN."""
    masked = np.ma.isMaskedArray(values)
    array = np.asarray(values)
    if array.dtype.kind not in "fiubO":
        raise InputError(source, "it holds no real numbers", "choose another signal", role)
    try:
        # A table's missing values become NaN, which the checks of a recording name.
        given = values.to_numpy(dtype=float, na_value=np.nan) if hasattr(values, "array") else array
        if _is_table(values):
            given = values.to_numpy(dtype=float, na_value=np.nan)
        if masked:
            given = np.ma.filled(np.ma.asarray(values).astype(float), np.nan)
        samples: NDArray[np.float64] = np.array(given, dtype=float).reshape(array.shape)
    except (TypeError, ValueError):
        raise InputError(
            source, "it holds no real numbers", "choose another signal", role
        ) from None
    if samples.ndim == 1:
        return samples[:, None]
    if samples.ndim == 2 and samples.shape[0] == 1:
        return samples.T
    if samples.ndim != 2 or samples.shape[1] > samples.shape[0]:
        raise InputError(
            source,
            f"the signals have the shape {samples.shape}",
            "give samples in rows and channels in columns",
            role,
        )
    return samples


def _check_alike(indexes: Sequence[Any], source: str) -> None:
    """Refuse to pair samples whose indexes differ."""
    for other in indexes[1:]:
        if not _are_equal(indexes[0], other):
            raise InputError(
                source,
                "the indexes of input and output differ, and samples are not paired by position",
                "bring both to one index, as by pandas.concat([input, output], axis=1,"
                ' join="inner"), or give arrays',
            )


def _are_equal(one: Any, other: Any) -> bool:
    if len(one) != len(other):
        return False
    if one.equals(other):
        return True
    stamps = np.asarray(one), np.asarray(other)
    if any(each.dtype.kind != "f" or each.size < 2 for each in stamps):
        return False
    step = float(np.min(np.abs(np.diff(stamps[0]))))
    return bool(np.all(np.abs(stamps[0] - stamps[1]) <= 1e-6 * step))


def _rate(index: Any, wanted: Wanted, source: str) -> float | None:
    """The stated rate, checked against an index of dates; else that of an index of times."""
    stated = checked_rate(wanted.sampling_rate)
    stamps = None if index is None else np.asarray(index)
    if stamps is None or stamps.ndim != 1:
        return stated
    name = "index" if getattr(index, "name", None) is None else str(index.name)
    if stamps.dtype.kind in "Mm" or hasattr(index, "tz"):
        dates = index.tz_convert(None) if getattr(index, "tz", None) is not None else index
        return timing(np.asarray(dates), source, name, stated_rate=stated).rate
    if stated is None and stamps.dtype.kind == "f":
        return timing(stamps, source, name, time_unit=wanted.time_unit or "s").rate
    return stated


def _labels(values: Any, count: int) -> list[Any]:
    """The labels of the channels of samples, None where they have none."""
    if _is_table(values):
        return list(values.columns)
    return [getattr(values, "name", None)] if count == 1 else [None] * count


def _names(
    inputs: Sequence[Any], outputs: Sequence[Any]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of inputs and outputs, those of their roles where they cannot be told apart."""
    of_inputs, of_outputs = _roles(inputs, "input"), _roles(outputs, "output")
    first = tuple(map(_name, inputs, of_inputs))
    second = tuple(map(_name, outputs, of_outputs))
    if len({*first, *second}) == len(first) + len(second):
        return first, second
    return tuple(of_inputs), tuple(of_outputs)


def _roles(labels: Sequence[Any], role: str) -> list[str]:
    if len(labels) == 1:
        return [role]
    return [f"{role}_{number}" for number in range(1, len(labels) + 1)]


def _name(label: Any, role: str) -> str:
    name = "" if label is None else str(label).strip(" :")
    return role if name in _NOT_A_NAME or "*" in name or not name.isprintable() else name
