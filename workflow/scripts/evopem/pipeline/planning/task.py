"""One job: a stage of a data set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from evopem.config.settings import DatasetSettings
from evopem.results.layout import DatasetFiles


@dataclass(frozen=True)
class Task:
    """One job: a stage of a data set, with values of the stage's own wildcards."""

    settings: DatasetSettings
    files: DatasetFiles
    # Of the wildcards by their names, such as ``{"structure": "oe"}``.
    values: Mapping[str, str] = field(default_factory=dict)
    # How the candidates of a phase are divided into parts.
    candidates_per_job: int | Literal["auto"] = "auto"
