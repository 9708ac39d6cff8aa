"""The signals that a user hands over: columns of tables, series or arrays, and their rate."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from evopem.arrays import Array
from evopem.errors import InputError
from evopem.files.atomic import save_arrays
from evopem.signals.recording import numbered, paired_indexes, samples_of
from evopem.signals.timestamps import RATE_TOLERANCE, timing

DATA = "data"  # what an error calls the first argument of :func:`evopem.identify`

_NOT_A_NAME = ("", "file", "allow_pickle")  # names that numpy's own arguments have


@dataclass(frozen=True, eq=False)
class GivenSignals:
    """Inputs and outputs as they were handed over."""

    inputs: Array  # no columns for outputs alone
    outputs: Array
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
    is_number = isinstance(rate, Real) and not isinstance(rate, bool)
    if is_number and 0.0 < rate < sys.float_info.max:
        return float(rate)
    problem = f"{repr(rate)[:40]} is no rate"
    raise InputError("sampling_rate", problem, "give a positive number of Hz")


def given_signals(data: Any, wanted: Wanted, source: str = DATA) -> GivenSignals:
    """Take signals and their rate from what a user hands over.

    ``data``: a table whose columns are named, or the samples of the inputs, (N,) or (N, m); those
    of the outputs are then in ``wanted.output``.  ``source``: what an error calls the data.
    """
    if _is_table(data) and not _has_samples(wanted.output):
        inputs, input_labels = _columns(data, wanted.input, "input", source)
        outputs, output_labels = _columns(data, wanted.output, "output", source)
        shared = [label for label in output_labels if label in input_labels]
        if shared:
            problem = f"column {shared[0]!r} is the input as well"
            raise InputError("output", problem, "choose two different columns")
        indexes = [data.index]
    else:
        for name, label in (("input", wanted.input), ("time", wanted.time)):
            if label is not None:
                problem = "it names a column, and the data are no table"
                remedy = "give a pandas DataFrame, or the samples of input and output alone"
                raise InputError(name, problem, remedy)
        outputs = samples_of(wanted.output, source, "output")
        inputs = np.empty((len(outputs), 0)) if data is None else samples_of(data, source, "input")
        input_labels, output_labels = _labels(data, inputs), _labels(wanted.output, outputs)
        indexes = paired_indexes(data, wanted.output, source)
    rate = checked_rate(wanted.sampling_rate)
    if wanted.time is not None:
        stamps = np.asarray(_column(data, wanted.time, "time", source))
        name, unit = str(wanted.time), wanted.time_unit
        rate = timing(stamps, source, name, stated_rate=rate, time_unit=unit).rate
    elif indexes:
        rate = _rate(indexes[0], rate, wanted.time_unit, source)
    return GivenSignals(inputs, outputs, rate, *_names(input_labels, output_labels))


def given_recordings(data: Any, wanted: Wanted, source: str = DATA) -> tuple[GivenSignals, ...]:
    """The signals of one recording, or of each of a list of them that are one data set."""
    output = wanted.output
    if not _are_several(data) and not (data is None and _are_several(output)):
        return (given_signals(data, wanted, source),)
    outputs: list[Any] = list(output) if _are_several(output) else []
    several = list(data) if data is not None else [None] * len(outputs)
    if _is_table(several[0]) and not outputs and not _has_samples(output):
        outputs = [output] * len(several)
    if len(outputs) != len(several):
        problem = f"there are {len(several)} inputs and {len(outputs) or 'no'} outputs"
        remedy = "give a list of the input and of the output of each recording"
        raise InputError(source, problem, remedy)
    signals = tuple(
        given_signals(data, replace(wanted, output=response), f"{source}, recording {number}")
        for number, (data, response) in enumerate(zip(several, outputs, strict=True), start=1)
    )
    return tuple(alike(recording, signals[0], source) for recording in signals)


def alike(signals: GivenSignals, first: GivenSignals, source: str) -> GivenSignals:
    """The signals of a further recording, under the names of the first one."""
    rate, known = signals.sampling_rate, first.sampling_rate
    if rate and known and abs(rate / known - 1.0) > RATE_TOLERANCE:
        problem = f"a sampling rate is {rate:g} Hz, and that of the first recording is {known:g} Hz"
        raise InputError(source, problem, "give recordings of one rate")
    for role in ("inputs", "outputs"):
        channels, expected = (getattr(recording, role).shape[1] for recording in (signals, first))
        if channels != expected:
            problem = f"a recording has {channels} {role}, and the first one {expected}"
            raise InputError(source, problem, "give recordings of the same channels")
    return replace(signals, input_names=first.input_names, output_names=first.output_names)


def _are_several(data: Any) -> bool:
    """Whether a list holds recordings, and not the samples of one."""
    listed = isinstance(data, list | tuple) and len(data) > 0
    return listed and (_is_table(data[0]) or np.ndim(data[0]) > 0)


def _is_table(data: Any) -> bool:
    return hasattr(data, "columns") and hasattr(data, "iloc")


def _has_samples(output: Any) -> bool:
    """Whether an argument holds samples, and no label of a column."""
    return hasattr(output, "iloc") or (isinstance(output, np.ndarray) and output.ndim > 0)


def _columns(table: Any, labels: Any, role: str, source: str) -> tuple[Array, list[Any]]:
    """The samples and labels of the inputs or outputs; a tuple may be one label itself."""
    listed = list(labels) if isinstance(labels, list | tuple) else [labels]
    if labels is None or (isinstance(labels, tuple) and _places(table, labels)):
        listed = [] if labels is None else [labels]
    if role == "output" and not listed:
        raise InputError("output", "it is missing", f"give one of {_listed(table)}")
    samples = [samples_of(_column(table, label, role, source), source, role) for label in listed]
    return np.hstack([np.empty((len(table), 0)), *samples]), listed


def _places(table: Any, label: Any) -> int:
    """How many columns have a label; a truth value is none, though it equals a number."""
    if isinstance(label, bool | np.bool_):
        return 0
    try:
        return sum(1 for column in table.columns if column == label)
    except (TypeError, ValueError):
        return 0


def _column(table: Any, label: Any, role: str, source: str) -> Any:
    places = _places(table, label)
    if places > 1:
        problem = f"{places} columns are called {label!r}"
        raise InputError(source, problem, "give each its own name", role)
    if not places:
        problem = f"there is no column {label!r}"
        raise InputError(source, problem, f"choose one of {_listed(table)}", role)
    return table[label]


def _listed(table: Any, most: int = 20) -> str:
    left = len(table.columns) - most
    shown = ", ".join(map(repr, table.columns[:most]))
    return f"{shown}, … and {left} more" if left > 0 else shown


def _rate(index: Any, stated: float | None, unit: str | None, source: str) -> float | None:
    """The stated rate, checked against an index of dates; else that of an index of times."""
    zone = getattr(index, "tz", None)
    stamps = np.asarray(index if zone is None else index.tz_convert(None))
    name = "index" if getattr(index, "name", None) is None else str(index.name)
    if stamps.dtype.kind in "Mm":
        return timing(stamps, source, name, stated_rate=stated).rate
    if stated is None and stamps.dtype.kind == "f" and stamps.ndim == 1:
        return timing(stamps, source, name, time_unit=unit or "s").rate
    return stated


def _labels(values: Any, samples: Array) -> list[Any]:
    """The labels of the channels of samples, None where they have none."""
    if _is_table(values):
        return list(values.columns)
    return [getattr(values, "name", None)] * samples.shape[1]


def _names(*labels: Sequence[Any]) -> list[tuple[str, ...]]:
    """Names of inputs and outputs, those of their roles where they are the same."""
    roles = [
        numbered(role, len(label), "_")
        for label, role in zip(labels, ("input", "output"), strict=True)
    ]
    named = [tuple(map(_name, *labelled)) for labelled in zip(labels, roles, strict=True)]
    names = [name for names in named for name in names]
    return named if len(set(names)) == len(names) else roles


def _name(label: Any, role: str) -> str:
    name = "" if label is None else str(label).strip(" :")
    return role if name in _NOT_A_NAME or "*" in name or not name.isprintable() else name
