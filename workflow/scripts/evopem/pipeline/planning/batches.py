"""What the rule of a batch of recordings asks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from evopem.config import resources
from evopem.config.configuration import Configuration
from evopem.files.json_form import to_json
from evopem.pipeline.planning.job_resources import JobResources
from evopem.pipeline.planning.wildcards import BatchWildcards, OfDataset
from evopem.results.layout import DatasetFiles
from evopem.results.made_from import is_finished


@dataclass(frozen=True)
class Batches:
    """The recordings of a batch: their files, settings and resources."""

    config: Configuration

    def files(self, wildcards: BatchWildcards) -> list[str]:
        """The recorded files of a batch that exist: the job of a batch knows what it has read."""
        return [
            path
            for name in self.config.batches[wildcards.batch]
            for path in self.config.datasets[name].source.all_files
            if resources.is_file(path)
        ]

    def settings(self, wildcards: BatchWildcards) -> dict[str, Any]:
        """The settings of the recordings of a batch, by their names."""
        names = self.config.batches[wildcards.batch]
        return {name: to_json(self.config.datasets[name]) for name in names}

    def memory(self, wildcards: BatchWildcards, threads: int, attempt: int) -> int:
        """MB of the job of a batch: those of its largest recording."""
        own = map(OfDataset, self.config.batches[wildcards.batch])
        job = JobResources(self.config)
        return max(job.estimation_memory(each, threads, attempt) for each in own)

    def time(self, wildcards: BatchWildcards, threads: int, attempt: int) -> int:
        """Minutes of the job of a batch: a margin for all, and what each recording may take."""
        own = map(OfDataset, self.config.batches[wildcards.batch])
        job = JobResources(self.config)
        margin = attempt * resources.MARGIN_MINUTES
        return margin + sum(job.estimation_time(each, threads, attempt) - margin for each in own)

    def unfinished(self, batches: Iterable[str], code: str) -> set[str]:
        """Names of the recordings of batches that their jobs would identify."""
        return {
            name
            for batch in batches
            for name in self.config.batches[batch]
            if not is_finished(DatasetFiles.of_dataset(name), self.config.datasets[name], code)
        }
