"""The keys that say where the samples of a data set come from, checked and completed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evopem.config.dataset_names import RESERVED_NAMES, RESULTS_FOLDER
from evopem.config.settings import SyntheticSource
from evopem.config.strict_yaml import Keys
from evopem.config.table import check_locale
from evopem.config.yaml_form import ANALYSIS_KEYS, FILE_KEYS, NO_INPUT, SYNTHESIS_KEYS, files_of
from evopem.errors import InputError
from evopem.files.json_form import to_json

_CHANNEL_DEFAULTS = {
    "input": 1,
    "output": 2,
    "input_unit": "",
    "output_unit": "",
    "uneven_time": "refuse",
}


_RATE_KEYS = ("sampling_rate", "time")


def complete_source(
    written: Keys, source: str, place: str, with_input: bool = True
) -> dict[str, Any]:
    """Check and complete the keys of a recorded file or of a synthetic recording.

    Parameters
    ----------
    written : mapping
        All keys of the data set.
    source, place : str
        The configuration and the key of the data set, for an error to name.
    with_input : bool
        Whether the structure of the model has an input.

    Raises
    ------
    InputError
        For a missing or a second source, keys of another kind of source, channels that are the
        same, and paths that no workflow can read.
    """
    kinds = [key for key in ("file", "synthesis") if key in written]
    if len(kinds) != 1:
        found = "are both given" if kinds else "are both missing"
        raise InputError(
            source, f"file and synthesis {found}", "give exactly one of the two", place
        )
    kind = kinds[0] if kinds[0] == "file" else written["synthesis"]
    own_keys = [key for key in written if key not in ANALYSIS_KEYS]
    foreign = next((key for key in own_keys if key not in _known_keys(kind)), None)
    if foreign:
        other = "a synthetic" if kind == "file" else "a recorded"
        if kind == "flexible_arm" and foreign == "noise":
            other = "an armax"
        raise InputError(
            source,
            f"the key belongs to {other} data set, and this one has `{kinds[0]}: "
            f"{written[kinds[0]]}`",
            "remove it",
            f"{place}.{foreign}",
        )
    if kind == "file":
        return _completed_file(written, own_keys, source, place, with_input)
    completed: dict[str, Any] = to_json(SyntheticSource(written["synthesis"]))
    if kind == "armax":
        completed["noise"] = 0.1
    return completed | {key: written[key] for key in own_keys}


def check_paths(datasets: Mapping[str, Keys], source: str) -> None:
    """Refuse a recorded file that lies among the results, or is its own validation file.

    A result of any data set is refused, not of the same one alone: Snakemake deletes the outputs
    of a job before it runs, and would run the data sets one after the other, or in a circle.

    Parameters
    ----------
    datasets : mapping
        The written keys of every data set.
    source : str
        For an error to name.

    Raises
    ------
    InputError
    """
    real_path = _RealPaths()
    results = os.path.realpath(RESULTS_FOLDER)
    folders = {name.lower() for name in (*datasets, *RESERVED_NAMES)}
    for name, written in datasets.items():
        for path, key in _paths(written):
            inside = Path(os.path.relpath(real_path(path), results)).parts
            if not inside or inside[0].lower() in folders:
                raise InputError(
                    source,
                    f"{path} is a result of this workflow",
                    "copy it to a folder of recordings and name the copy",
                    f"datasets.{name}.{key}",
                )
        _check_each_once(_paths(written), real_path, source, f"datasets.{name}")


def _paths(written: Keys) -> list[tuple[str, str]]:
    """The paths of a data set, each with its key."""
    return [
        (path, key) for key in ("file", "validation_file") for path in files_of(written.get(key))
    ]


def _check_each_once(
    paths: list[tuple[str, str]], real_path: _RealPaths, source: str, place: str
) -> None:
    """Refuse a file that is two recordings of a data set, under whatever names."""
    known: dict[object, tuple[str, str]] = {}
    for path, key in paths if len(paths) > 1 else ():
        for identity in filter(None, (real_path(path), _identity(path))):
            if identity not in known:
                known[identity] = (path, key)
                continue
            earlier, earlier_key = known[identity]
            written_as = "" if earlier == path else f" ({earlier})"
            if earlier_key == key:
                problem = f"{path} stands there twice{written_as}"
                remedy = "give every recording once"
            else:
                problem = f"{path} is also the estimation file{written_as}"
                remedy = "give an independent recording, or leave the key out to cut this one"
            raise InputError(source, problem, remedy, f"{place}.{key}")


def _identity(path: str) -> tuple[int, int] | None:
    """What all paths to one file have in common, hard links too; None where there is no file."""
    try:
        found = os.stat(path)  # noqa: PTH116
    except (OSError, ValueError):
        return None
    return found.st_dev, found.st_ino


class _RealPaths:
    """The paths of files without links and dots, quick for many files in one folder."""

    def __init__(self) -> None:
        self.folders: dict[str, str] = {}

    def __call__(self, path: str) -> str:
        folder, name = os.path.split(path)
        if name in ("", ".", ".."):
            return os.path.realpath(path)
        if folder not in self.folders:
            self.folders[folder] = os.path.realpath(folder)
        inside = os.path.join(self.folders[folder], name)  # noqa: PTH118
        return os.path.realpath(inside) if os.path.islink(inside) else inside  # noqa: PTH114


def _known_keys(kind: str) -> set[str]:
    """The keys of a kind of source."""
    if kind == "file":
        return set(FILE_KEYS)
    return set(SYNTHESIS_KEYS) - ({"noise"} if kind == "flexible_arm" else set())


def _completed_file(
    written: Keys, own_keys: list[str], source: str, place: str, with_input: bool
) -> dict[str, Any]:
    if "time" in written and "sampling_rate" in written:
        raise InputError(
            source, "both sampling_rate and time are given", "give one of the two", place
        )
    completed = dict.fromkeys(FILE_KEYS) | _CHANNEL_DEFAULTS
    if not with_input:
        completed |= {"input": NO_INPUT, "output": 1}
    completed |= {key: written[key] for key in own_keys}
    if with_input and not any(key in written for key in ("input", "output", *_RATE_KEYS)):
        completed |= {"input": None, "output": None}  # told from the file
    check_file_paths(completed, source, place)
    for one, other in (("input", "output"), ("time", "input"), ("time", "output")):
        if completed[one] is not None and completed[one] == completed[other]:
            raise InputError(
                source,
                f"{completed[one]} is both {one} and {other}",
                "name two different columns",
                f"{place}.{other}",
            )
    return completed


def check_file_paths(keys: Keys, source: str, place: str) -> None:
    """Refuse paths of recorded files that no workflow can read.

    Raises
    ------
    InputError
    """
    for path, key in _paths(keys):
        _check_path(path, source, f"{place}.{key}")


def _check_path(path: str, source: str, place: str) -> None:
    if {"{", "}"} & set(path):
        raise InputError(
            source,
            f"the braces in {path} have a meaning of their own in a workflow",
            "rename the file",
            place,
        )
    if "\n" in path or "\r" in path:
        raise InputError(source, f"there is a line break in {path!r}", "remove it", place)
    check_locale(path, source, place)
