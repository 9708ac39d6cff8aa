"""Many data sets side by side: the summary of each, and one table of all modes and checks."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evopem.results.dataset import read_json, read_table
from evopem.validation.checks import checks

if TYPE_CHECKING:
    import pandas as pd

Summary = dict[str, Any]

_ERRORS = (
    "prediction_error_percent",
    "simulation_error_percent",
    "continued_simulation_error_percent",
)
_RECORD = ("file", "sha256", "sampling_rate", "estimation_samples", "validation_samples")
_ORDERS = ("na", "nb", "nc", "nk")
_MODE = ("frequency_hz", "frequency_se_hz", "damping_percent", "damping_se_percent")
_STAMP = re.compile(r"^\d\d:\d\d:\d\d ")


def summarize(paths: Mapping[str, Path]) -> Summary:
    """Summarize one data set: its model's orders and modes, its errors and checks.

    Parameters
    ----------
    paths : mapping of str to Path
        ``recording.json``, ``transforms.json``, ``spectrum.json``, ``candidates.csv``,
        ``model.json`` and ``validation.json`` by these names.

    Raises
    ------
    InputError
        When a file is missing or damaged.
    """
    model, validation = read_json(paths["model.json"]), read_json(paths["validation.json"])
    recording, transforms = read_json(paths["recording.json"]), read_json(paths["transforms.json"])
    spectrum, candidates = read_json(paths["spectrum.json"]), read_table(paths["candidates.csv"])
    verdicts = checks(model, validation, spectrum, candidates, recording)
    return {
        "file": recording.get("path"),
        "sha256": recording.get("sha256"),
        "sampling_rate": transforms["sampling_rate"],
        "estimation_samples": transforms["estimation_samples"],
        "validation_samples": transforms["validation_samples"],
        "orders": model["orders"],
        "bic": model["bic"],
        **{key: validation.get(key) for key in _ERRORS},
        "checks": {check.name: check.passed for check in verdicts},
        "modes": [{key: mode.get(key) for key in _MODE} for mode in model["modes"]],
    }


def read_summaries(directory: Path, names: Sequence[str]) -> dict[str, Summary]:
    """Read the summary of every data set; of one that has none, what its last log says.

    Parameters
    ----------
    directory : Path
        Where the data sets' folders are.
    names : sequence of str
        Names of the data sets.
    """
    return {name: _summary(directory / name) for name in names}


def fleet_table(summaries: Mapping[str, Summary]) -> pd.DataFrame:
    """Put every mode of every data set into one table.

    A data set without modes, or without a model, has one row; what it lacks is empty.
    """
    import pandas as pd

    checked = dict.fromkeys(
        check for summary in summaries.values() for check in summary.get("checks", {})
    )
    rows = []
    for name, summary in summaries.items():
        own = {
            "dataset": name,
            "status": "failed" if "problem" in summary else "complete",
            "problem": summary.get("problem"),
            **{key: summary.get(key) for key in _RECORD},
            **{key: summary.get("orders", {}).get(key) for key in _ORDERS},
            "bic": summary.get("bic"),
            **{key: summary.get(key) for key in _ERRORS},
        }
        verdicts = {column_of(check): summary.get("checks", {}).get(check) for check in checked}
        own["failed_checks"] = sum(verdict is False for verdict in verdicts.values())
        for number, mode in enumerate(summary.get("modes") or [{}], start=1):
            rows.append(
                own
                | {"mode": number if mode else None}
                | {key: mode.get(key) for key in _MODE}
                | verdicts
            )
    whole = ("estimation_samples", "validation_samples", *_ORDERS, "mode", "failed_checks")
    table = pd.DataFrame(rows)
    numbers = ("sampling_rate", "bic", *_ERRORS, *_MODE)
    return table.astype(
        dict.fromkeys(("dataset", "status", "problem", "file", "sha256"), "string")
        | dict.fromkeys(whole, "Int64")
        | dict.fromkeys(numbers, "float64")
        | {column_of(check): "boolean" for check in checked}
    )


def column_of(check: str) -> str:
    """Name a check's column."""
    return "check_" + re.sub(r"\W+", "_", check.lower().replace("'s", "")).strip("_")


def _summary(folder: Path) -> Summary:
    path = folder / "summary.json"
    if path.exists():
        return read_json(path)
    return {"problem": _last_words(folder / "logs")}


def _last_words(logs: Path) -> str:
    """Find what the job said last that wrote to a data set's logs most recently."""
    newest = max(logs.rglob("*.log"), key=lambda log: log.stat().st_mtime_ns, default=None)
    if newest is None:
        return "nothing was computed"
    lines = newest.read_text(encoding="utf-8", errors="replace").split("\n")
    said = next((line for line in reversed(lines) if line.strip()), "")
    return _STAMP.sub("", said) or f"{newest.stem} came to no end"
