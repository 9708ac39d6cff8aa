"""Settings of the comparison: built-in values, and the keys of an optional file.

Imports neither NumPy nor pandas, because the Snakefile imports this module.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field

from evopem.config.keys import keys_of_fields, mapping
from evopem.config.schema import checked, normalized
from evopem.config.strict_yaml import check_yaml_files

Algorithm = Literal[
    "hybrid",
    "es",
    "ep",
    "ga",
    "hybrid-all",
    "hybrid-best",
    "hybrid-random",
    "hybrid-small",
    "default",
    "multi-start",
    "multi-start-scipy",
    "multi-start-lbfgsb",
    "multi-start-least-squares",
    "basin-hopping",
    "monotonic-basin-hopping",
    "least-squares-hopping",
    "cma-es",
    "differential-evolution",
    "dual-annealing",
]
Dimension = Annotated[int, Field(ge=2, le=100, description="a whole number from 2 to 100")]
Count = Annotated[int, Field(ge=1, description="a whole number of at least 1")]


@dataclass(frozen=True)
class ScaleSettings:
    """Settings of the study of scale."""

    dimensions: Annotated[
        tuple[Dimension, ...],
        Field(min_length=1, description="a list of whole numbers from 2 to 100"),
    ] = (5, 10, 20, 40, 70, 100)
    runs: Count = 2  # of each algorithm on each instance


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

    algorithms: Annotated[
        tuple[Annotated[Algorithm, Field(description="the name of an algorithm")], ...],
        Field(min_length=1, description="a list of algorithms"),
    ] = Algorithm.__args__  # type: ignore[attr-defined]
    dimension: Annotated[
        Dimension, Field(description="the number of variables, a whole number from 2 to 100")
    ] = 20
    evaluations: Annotated[
        int, Field(ge=100, description="a whole number of at least 100 evaluations of a run")
    ] = 200_000
    instances: Count = 10
    runs: Count = 10
    slow_runs: Count = 2
    scale: ScaleSettings = field(default_factory=ScaleSettings)
    runs_per_job: Count = 10
    seed: Annotated[int, Field(ge=0, description="a whole number of at least 0")] = 1


_KEYS = mapping(
    "Settings",
    keys_of_fields(Settings)
    | {
        "scale": Annotated[
            mapping("Scale", keys_of_fields(ScaleSettings)),
            Field(description="a mapping of dimensions and runs"),
        ]
    },
)


def read_settings(file: str | Path) -> Settings:
    """Read the settings: the built-in values, replaced by those in a file.

    Parameters
    ----------
    file : path
        YAML with some of the keys. It may be missing or empty.

    Raises
    ------
    InputError
        For broken YAML, an unknown key or a value outside its range.
    """
    keys = checked(_KEYS, normalized(_written(Path(file)), str(file)), str(file))
    return Settings(**(keys | {"scale": ScaleSettings(**keys.get("scale", {}))}))


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
