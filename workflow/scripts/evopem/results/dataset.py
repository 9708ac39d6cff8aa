"""The result files of one data set, read once for figures and report."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from evopem.errors import InputError

if TYPE_CHECKING:
    from evopem.signals.preparation import PreparedData
    from evopem.signals.recording import Recording

REQUIRED = (
    "recording.npz",
    "prepared.npz",
    "transforms.json",
    "spectrum.csv",
    "spectrum.json",
    "candidates.csv",
    "model.json",
    "residual_autocorrelation.csv",
    "cross_correlation.csv",
    "frequency_response.csv",
    "simulation.csv",
    "validation.json",
)
PHASES = ("delay", "common", "c", "b")


@dataclass(frozen=True)
class Results:
    """Contents of a data set's result files, by the names of the files."""

    recording: Recording
    prepared: PreparedData
    transforms: Mapping[str, Any]
    spectrum: pd.DataFrame
    spectrum_summary: Mapping[str, Any]
    candidates: pd.DataFrame
    phases: Mapping[str, Mapping[str, Any]]
    model: Mapping[str, Any]
    residual_autocorrelation: pd.DataFrame
    cross_correlation: pd.DataFrame
    frequency_response: pd.DataFrame
    simulation: pd.DataFrame
    validation: Mapping[str, Any]
    truth: Mapping[str, Any] | None
    recording_summary: Mapping[str, Any] | None

    def chosen_candidate(self) -> Mapping[str, Any] | None:
        """Record of the candidate that became the model; None without records."""
        return candidate_of(self.model["orders"], self.phases)


def result_paths(directory: Path) -> dict[str, Path]:
    """Every result file of a data set's directory, by its name relative to the directory."""
    return {
        path.relative_to(directory).as_posix(): path
        for path in sorted(directory.rglob("*"))
        if path.is_file()
    }


def read_results(paths: Mapping[str, Path]) -> Results:
    """Read the result files of one data set.

    Parameters
    ----------
    paths : mapping of str to Path
        Files by their names relative to the data set's directory, such as ``model.json`` or
        ``phases/delay.json``; others are passed over. ``truth.json``, ``recording.json`` and
        ``phases/*.json`` may be missing.

    Raises
    ------
    InputError
        When a required file is missing or damaged.
    """
    from evopem.signals.preparation import load_prepared
    from evopem.signals.recording import load_recording

    require(REQUIRED, paths)
    return Results(
        recording=load_recording(paths["recording.npz"]),
        prepared=load_prepared(paths["prepared.npz"], paths["transforms.json"]),
        transforms=read_json(paths["transforms.json"]),
        spectrum=read_table(paths["spectrum.csv"]),
        spectrum_summary=read_json(paths["spectrum.json"]),
        candidates=read_table(paths["candidates.csv"]),
        phases=read_phases(paths),
        model=read_json(paths["model.json"]),
        residual_autocorrelation=read_table(paths["residual_autocorrelation.csv"]),
        cross_correlation=read_table(paths["cross_correlation.csv"]),
        frequency_response=read_table(paths["frequency_response.csv"]),
        simulation=read_table(paths["simulation.csv"]),
        validation=read_json(paths["validation.json"]),
        truth=read_optional(paths, "truth.json"),
        recording_summary=read_optional(paths, "recording.json"),
    )


def require(names: Iterable[str], paths: Mapping[str, Path]) -> None:
    """Refuse results that lack one of the files.

    Raises
    ------
    InputError
        Naming the first one that is missing.
    """
    for name in names:
        if name not in paths:
            raise InputError(name, "is not among the results", "run the stage that writes it")


def read_phases(paths: Mapping[str, Path]) -> dict[str, dict[str, Any]]:
    """Read the record of every phase of the order search that is there."""
    return {
        phase: read_json(paths[f"phases/{phase}.json"])
        for phase in PHASES
        if f"phases/{phase}.json" in paths
    }


def candidate_of(
    orders: Mapping[str, int], phases: Mapping[str, Mapping[str, Any]]
) -> Mapping[str, Any] | None:
    """Record of the candidate of these orders, from the last phase that tried it."""
    for phase in reversed(PHASES):
        for candidate in phases.get(phase, {}).get("candidates", []):
            if all(candidate.get(key) == value for key, value in orders.items()):
                return candidate
    return None


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object.

    Raises
    ------
    InputError
        When the file is missing or does not hold an object.
    """
    remedy = "make the file again by running the stage that writes it"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise InputError(str(path), "cannot be read", remedy) from None
    except ValueError:
        raise InputError(str(path), "is not valid JSON", remedy) from None
    if not isinstance(content, dict):
        raise InputError(str(path), "does not hold a JSON object", remedy)
    return content


def read_optional(paths: Mapping[str, Path], name: str) -> dict[str, Any] | None:
    """Read a JSON object that need not be among the results; None where it is not."""
    return read_json(paths[name]) if name in paths else None


def read_table(path: Path) -> pd.DataFrame:
    """Read a CSV table.

    Raises
    ------
    InputError
        When the file is missing or not a table.
    """
    try:
        return pd.read_csv(path)
    except (OSError, ValueError):
        raise InputError(
            str(path),
            "is not a readable table",
            "make the file again by running the stage that writes it",
        ) from None
