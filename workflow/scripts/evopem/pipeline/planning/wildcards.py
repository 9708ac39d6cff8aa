"""The wildcards of jobs, and the paths in which they stand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from evopem.config.configuration import Configuration
from evopem.config.settings import DatasetSettings
from evopem.results.layout import DatasetFiles

FILES = DatasetFiles.of_dataset("{dataset}")
"""The files of a data set, with the wildcard in their paths."""


class Wildcards(Protocol):
    """The wildcards of a job."""

    dataset: str
    phase: str

    def get(self, name: str) -> str | None:
        """Value of a wildcard, None where the job has no such one."""


class BatchWildcards(Protocol):
    """The wildcards of the job of a batch."""

    batch: str


@dataclass
class OfDataset:
    """The wildcards of the job of one recording, where Snakemake has planned that of a batch."""

    dataset: str
    phase: str = ""

    def get(self, name: str) -> str | None:
        """Value of a wildcard, None where the job has no such one."""
        return getattr(self, name, None) or None


@dataclass(frozen=True)
class SingleChannel:
    """The data sets with one input and one output, or an output alone."""

    config: Configuration

    def _of(self, wildcards: Wildcards) -> DatasetSettings:
        return self.config.single_channel[wildcards.dataset]
