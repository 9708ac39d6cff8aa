"""Memory and time of jobs."""

from __future__ import annotations

from dataclasses import dataclass

from evopem.config import resources
from evopem.pipeline.planning.wildcards import SingleChannel, Wildcards


@dataclass(frozen=True)
class JobResources(SingleChannel):
    """Memory and time that a job asks for, by the settings of its data set."""

    def reading_memory(self, wildcards: Wildcards, attempt: int) -> int:
        """MB of a job that reads a recording once."""
        return resources.reading_memory(self.config.datasets[wildcards.dataset], attempt)

    def reading_time(self, wildcards: Wildcards, attempt: int) -> int:
        """Minutes of a job that reads a recording once."""
        return resources.reading_time(self.config.datasets[wildcards.dataset], attempt)

    def model_memory(self, wildcards: Wildcards, attempt: int) -> int:
        """MB of the job that completes the model, and estimates it where there are constraints."""
        if self._of(wildcards).fit.changes_model:
            return resources.estimation_memory(self._of(wildcards), 1, attempt)
        return resources.reading_memory(self._of(wildcards), attempt)

    def model_time(self, wildcards: Wildcards, attempt: int) -> int:
        """Minutes of that job."""
        if self._of(wildcards).fit.changes_model:
            return resources.estimation_time(self._of(wildcards), "joint", 1, 1, attempt)
        return resources.reading_time(self._of(wildcards), attempt)

    def estimation_memory(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """MB of a job that estimates candidates, or models of several channels."""
        if wildcards.dataset in self.config.multichannel:
            return self.state_space_memory(wildcards, attempt)
        return resources.estimation_memory(self._of(wildcards), threads, attempt)

    def estimation_time(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """Minutes of a job that estimates the candidates of a phase, or of all of them."""
        if wildcards.dataset in self.config.multichannel:
            return self.state_space_time(wildcards, attempt)
        return resources.estimation_time(
            self._of(wildcards),
            wildcards.get("phase"),
            self.config.run.candidates_per_job,
            threads,
            attempt,
        )

    def state_space_memory(self, wildcards: Wildcards, attempt: int) -> int:
        """MB of a job that estimates models of several channels."""
        return resources.state_space_memory(self.config.multichannel[wildcards.dataset], attempt)

    def state_space_time(self, wildcards: Wildcards, attempt: int) -> int:
        """Minutes of a job that estimates models of several channels."""
        return resources.state_space_time(self.config.multichannel[wildcards.dataset], attempt)
