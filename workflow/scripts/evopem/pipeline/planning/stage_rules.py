"""The rules of a workflow: what runs one stage, or all stages, of the data sets that have it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from evopem.config.settings import DatasetSettings
from evopem.files.json_form import to_json
from evopem.pipeline.planning.stage import Stage
from evopem.pipeline.planning.stages import PREPARING, STAGES, stages_of
from evopem.pipeline.planning.task import Task
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from evopem.pipeline.planning.provider import Provider

FILES = DatasetFiles.of_dataset("{dataset}")
"""The files of a data set, with the wildcard in their paths."""


class Wildcards(Protocol):
    """The wildcards of a job: ``dataset``, or ``batch``, and those of its stage."""

    dataset: str
    batch: str

    def get(self, name: str) -> str | None:
        """Value of a wildcard, None where the job has no such one."""


@dataclass(frozen=True)
class StageRule:
    """A rule: what runs a stage for each data set that has it."""

    provider: Provider
    name: str
    stages: dict[str, Stage]  # by the names of the data sets
    outputs: list[str]  # paths with wildcards

    @property
    def any_stage(self) -> Stage:
        """One of the stages, which have the same name and wildcards."""
        return next(iter(self.stages.values()))

    @property
    def datasets(self) -> str:
        """A constraint of the wildcard to the data sets that the rule is for."""
        return self.provider.one_of(self.stages)

    @property
    def log(self) -> str:
        """Path of the log, with wildcards."""
        return FILES.log(self.any_stage.job)

    @property
    def benchmark(self) -> str:
        """Path of the measured times, with wildcards."""
        return FILES.benchmark(self.any_stage.job)

    @property
    def priority(self) -> int:
        """What is read and prepared comes first, so that a bad recording is told before any search.

        Then data sets come to their end one after the other, not all at once.
        """
        names = list(dict.fromkeys(stage.name for stage in STAGES))
        stage = self.any_stage.name
        return 1000 if stage in PREPARING else names.index(stage)

    @property
    def is_small(self) -> bool:
        """Whether its jobs run beside Snakemake, without one of a cluster."""
        return self.any_stage.name in ("write_settings", "tabulate", "collect_decisions")

    def recorded(self, wildcards: Wildcards) -> list[str]:
        """The recorded files that a job reads."""
        return [
            path
            for key in self.stages[wildcards.dataset].recorded
            for path in self.provider.recorded_files(wildcards.dataset, key)
        ]

    def inputs(self, wildcards: Wildcards) -> list[str]:
        """The results that a job reads."""
        return self.stages[wildcards.dataset].read_by(self._task(wildcards))

    def function(self, wildcards: Wildcards) -> str:
        """The function that a job calls."""
        return self.stages[wildcards.dataset].function

    def modules(self, wildcards: Wildcards) -> list[Path]:
        """The modules whose code a job runs."""
        return [self.stages[wildcards.dataset].module]

    def arguments(self, wildcards: Wildcards) -> Any:
        """What a job is given of the settings."""
        return to_json(self.stages[wildcards.dataset].arguments(self._task(wildcards)))

    def memory(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """MB that a job asks for."""
        demand = self.stages[wildcards.dataset].demand
        return self.provider.memory(demand, wildcards.dataset, threads, attempt)

    def time(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """Minutes that a job asks for."""
        demand, phase = self.stages[wildcards.dataset].demand, wildcards.get("phase")
        return self.provider.time(demand, wildcards.dataset, phase, threads, attempt)

    def _task(self, wildcards: Wildcards) -> Task:
        stage = self.stages[wildcards.dataset]
        values = {name: wildcards.get(name) or "" for name in stage.wildcards}
        return self.provider.task(wildcards.dataset, values)


@dataclass(frozen=True)
class RecordingRule:
    """A rule: what takes data sets with the same results through all stages."""

    provider: Provider
    name: str
    members: frozenset[str]  # names of the data sets
    outputs: list[str]  # paths with the wildcard of the data set

    @property
    def datasets(self) -> str:
        """A constraint of the wildcard to the data sets that the rule is for."""
        return self.provider.one_of(self.members)

    def recorded(self, wildcards: Wildcards) -> list[str]:
        """The recorded files of a data set."""
        return [
            path
            for key in ("files", "validation_files")
            for path in self.provider.recorded_files(wildcards.dataset, key)
        ]

    def modules(self, wildcards: Wildcards) -> list[Path]:
        """The modules whose code a job runs."""
        settings = self.provider.config.datasets[wildcards.dataset]
        return modules_of([settings], self.provider.with_report)

    def arguments(self, wildcards: Wildcards) -> dict[str, Any]:
        """What a job is given."""
        settings = to_json(self.provider.config.datasets[wildcards.dataset])
        return {"settings": settings, "with_report": self.provider.with_report}

    def memory(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """MB that a job asks for."""
        return self.provider.memory("estimation", wildcards.dataset, threads, attempt)

    def time(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """Minutes that a job asks for."""
        return self.provider.time("estimation", wildcards.dataset, None, threads, attempt)


def modules_of(datasets: Iterable[DatasetSettings], with_report: bool) -> list[Path]:
    """The modules with the functions of all stages of some data sets."""
    stages = {stage.module for each in datasets for stage in stages_of(each, with_report)}
    return sorted(stages)
