"""Settings of the comparison: built-in values, and the keys of an optional file.

Imports neither NumPy nor pandas, because the Snakefile imports this module.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from evopem.config.schema import check_schema
from evopem.config.strict_yaml import check_yaml_files
from evopem.files.json_form import from_json

SCHEMA = Path(__file__).parents[2] / "settings.schema.yaml"


@dataclass(frozen=True)
class ScaleSettings:
    """Settings of the study of scale.

    Attributes
    ----------
    dimensions : tuple of int
    runs : int
        Runs of each algorithm on each instance.
    """

    dimensions: tuple[int, ...]
    runs: int


@dataclass(frozen=True)
class Settings:
    """Settings of the comparison.

    Attributes
    ----------
    algorithms : tuple of str
        Names in `fletcher_powell.algorithms.ALGORITHMS`.
    dimension : int
        Number of variables n in the studies ``table`` and ``precise``.
    evaluations : int
        Evaluations of a run in that dimension; in proportion to n in others.
    instances : int
    runs : int
        Runs of each algorithm on each instance.
    slow_runs : int
        At most so many runs of the algorithms in `fletcher_powell.experiments.SLOW`.
    scale : ScaleSettings
    runs_per_job : int
        Runs that one job makes. Results do not depend on it.
    seed : int
    """

    algorithms: tuple[str, ...]
    dimension: int
    evaluations: int
    instances: int
    runs: int
    slow_runs: int
    scale: ScaleSettings
    runs_per_job: int
    seed: int


def read_settings(file: str | Path) -> Settings:
    """Read the settings: the built-in values, replaced by those in a file.

    Parameters
    ----------
    file : path
        YAML with some of the keys in ``settings.schema.yaml``. It may be missing or empty.

    Raises
    ------
    InputError
        For broken YAML, an unknown key or a value outside its range.
    """
    schema = yaml.safe_load(SCHEMA.read_text(encoding="utf-8"))
    written = _written(Path(file))
    check_schema(written, schema, str(file))
    return from_json(Settings, _completed(schema, written), str(file))


def _written(file: Path) -> dict[str, Any]:
    """Keys in the file; none if it is missing or holds comments alone."""
    if not file.is_file():
        return {}
    lines = (line.strip() for line in file.read_bytes().splitlines())
    if all(not line or line.startswith(b"#") for line in lines):
        return {}
    check_yaml_files([file])
    keys: dict[str, Any] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return keys


def _completed(schema: Mapping[str, Any], written: Mapping[str, Any]) -> dict[str, Any]:
    """Every key of the schema: the written value, else the schema's default."""
    return {
        key: _completed(child, written.get(key, {}))
        if "properties" in child
        else _with_integers(written.get(key, child["default"]))
        for key, child in schema["properties"].items()
    }


def _with_integers(value: Any) -> Any:
    """A value with 3.0 written as 3: all numbers of these settings are whole ones."""
    if isinstance(value, list):
        return [_with_integers(each) for each in value]
    return int(value) if isinstance(value, float) else value
