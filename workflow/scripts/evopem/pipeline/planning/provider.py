"""What rules ask of a configuration: stages with their files, arguments and resources.

A rule gives these methods to Snakemake, which calls them with the wildcards of each job. Nothing
here imports numpy, pandas or Snakemake.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from evopem.config import resources
from evopem.config.configuration import Configuration
from evopem.config.sample_sheet import RESERVED_NAMES
from evopem.files.json_form import to_json
from evopem.pipeline.planning.stage import Demand, Stage
from evopem.pipeline.planning.stage_rules import FILES, RecordingRule, StageRule, Wildcards
from evopem.pipeline.planning.stages import STAGES, results_of, stages_of
from evopem.pipeline.planning.task import Task
from evopem.results.layout import BATCH_CHECKSUMS, OVERVIEW, DatasetFiles
from evopem.results.made_from import is_finished, was_read_from

_RESERVED = "|".join(map(re.escape, RESERVED_NAMES))
DATASET_PATTERN = rf"(?!(?:{_RESERVED})/)[A-Za-z0-9][A-Za-z0-9_.-]*"
"""The form of a data set's name. A folder with a reserved name belongs to no data set."""

IDENTIFY = "identification:identify"
"""The function that runs all stages of a data set."""

LIST = "fleet:collect_fleet"
"""The function that lists all data sets."""


@dataclass(frozen=True)
class Provider:
    """The configuration of a run, as its rules read it."""

    config: Configuration

    @cached_property
    def rules(self) -> list[StageRule]:
        """One rule for each stage.

        The outputs of a rule may not depend on the data set: where they differ, there are several
        rules, with numbers behind the name.
        """
        rules = []
        for name in dict.fromkeys(stage.name for stage in STAGES):
            members: dict[tuple[str, ...], dict[str, Stage]] = {}
            for dataset, settings in self.config.datasets.items():
                for stage in stages_of(settings, self.with_report):
                    if stage.name == name:
                        own = {wildcard: f"{{{wildcard}}}" for wildcard in stage.wildcards}
                        outputs = tuple(sorted(stage.made_by(Task(settings, FILES, own))))
                        members.setdefault(outputs, {})[dataset] = stage
            for number, (outputs, stages) in enumerate(members.items(), start=1):
                rules.append(StageRule(self, _numbered(name, number), stages, list(outputs)))
        return rules

    @cached_property
    def recording_rules(self) -> list[RecordingRule]:
        """The rule that takes a recording through all stages, one for each set of results."""
        members: dict[tuple[str, ...], list[str]] = {}
        for name in self.config.datasets:
            members.setdefault(tuple(self.results(name, FILES)), []).append(name)
        return [
            RecordingRule(self, _numbered("identify", number), frozenset(names), list(results))
            for number, (results, names) in enumerate(members.items(), start=1)
        ]

    def task(self, dataset: str, values: dict[str, str] | None = None) -> Task:
        """A job of a data set, with the wildcard in the paths of its files."""
        settings = self.config.datasets[dataset]
        return Task(settings, FILES, values or {}, self.config.run.candidates_per_job)

    def values(self, wildcard: str) -> str:
        """A constraint of a wildcard to the values that it has for any data set."""
        values = {
            task.values[wildcard]
            for settings in self.config.datasets.values()
            for stage in stages_of(settings)
            if wildcard in stage.wildcards and wildcard != "part"
            for task in stage.tasks(Task(settings, FILES))
        }
        return "|".join(map(re.escape, sorted(values))) or "(?!)"

    @property
    def with_report(self) -> bool:
        """Whether figures and reports are made."""
        return self.config.run.report == "html"

    @property
    def page(self) -> str:
        """The file of a data set that the list of all data sets links to."""
        return "report.html" if self.with_report else "modes.csv"

    @property
    def lists(self) -> list[str]:
        """The lists of all data sets; none for a shard.

        Nor are there any for a single data set, unless they exist from a run with several: then
        they are made again, so that they do not list data sets that have been removed.
        """
        if self.config.run.shard:
            return []
        several = len(self.config.datasets) > 1
        return [*OVERVIEW] if several or any(map(resources.is_file, OVERVIEW)) else []

    @property
    def targets(self) -> list[str]:
        """What a run makes, apart from the lists of all data sets."""
        if self.config.batches:
            return self.batch_checksums
        return [result for name in self.config.datasets for result in self.results(name)]

    @property
    def batch_checksums(self) -> list[str]:
        """The outputs of the jobs of all batches."""
        return [BATCH_CHECKSUMS.format(batch=batch) for batch in self.config.batches]

    @property
    def order(self) -> dict[str, Any]:
        """What recordings are ordered by where modes are followed; empty for their own order."""
        return to_json(self.config.order) if self.config.order else {}

    def results(self, dataset: str, files: DatasetFiles | None = None) -> list[str]:
        """The results of one data set, those that other jobs read among them.

        Snakemake does not make a missing file again that only finished jobs needed. All are asked
        for, so that whatever was deleted is made again.
        """
        own = files or DatasetFiles.of_dataset(dataset)
        if self.config.batches:
            return own.batch_results
        return results_of(self.config.datasets[dataset], own, self.with_report)

    @property
    def summaries(self) -> list[str]:
        """The summaries of all data sets; those of a batch are no outputs of Snakemake's jobs."""
        names = () if self.config.batches else self.config.datasets
        return [DatasetFiles.of_dataset(name).summary for name in names]

    @property
    def last_results(self) -> list[str]:
        """An output of each job that no other job of a data set waits for, but for its summary.

        Where one job makes all results of a data set, none; of batches the outputs of their jobs.
        """
        if self.config.run.one_job_per == "recording":
            return self.batch_checksums
        return [path for name in self.config.datasets for path in self._last_results(name)]

    def _last_results(self, dataset: str) -> list[str]:
        files, settings = DatasetFiles.of_dataset(dataset), self.config.datasets[dataset]
        whole = Task(settings, files)
        stages = stages_of(settings, self.with_report)
        jobs = [(stage, task) for stage in stages for task in stage.tasks(whole)]
        read = {path for stage, task in jobs for path in stage.read_by(task)} | {files.summary}
        made = [stage.made_by(task) for stage, task in jobs]
        return [outputs[0] for outputs in made if read.isdisjoint(outputs)]

    def one_of(self, names: Iterable[str]) -> str:
        """A wildcard constraint that matches these names and no other data set's.

        Where these are all data sets, the form of a name suffices: a list of thousands would be
        tried for each of thousands of files.
        """
        own = set(names)
        if len(own) == len(self.config.datasets):
            return DATASET_PATTERN
        return "|".join(map(re.escape, sorted(own))) or "(?!)"

    def recorded_files(self, dataset: str, key: str) -> list[str]:
        """The recorded files under a key of a data set's source that are inputs of a job.

        A missing file is no input before its first reading: its job then says so in a sentence,
        and the other data sets continue, where Snakemake would stop them all. One that was read
        before stays an input, so that nothing made from it is lost.
        """
        own = DatasetFiles.of_dataset(dataset)
        info = own.recording_info if key == "files" else own.validation_recording_info
        paths: Iterable[str] = getattr(self.config.datasets[dataset].source, key, ())
        return [path for path in paths if resources.is_file(path) or was_read_from(path, info)]

    # Of batches.

    def batch_files(self, wildcards: Wildcards) -> list[str]:
        """The recorded files of a batch that exist: the job of a batch knows what it has read."""
        return [
            path
            for name in self.config.batches[wildcards.batch]
            for path in self.config.datasets[name].source.all_files
            if resources.is_file(path)
        ]

    def batch_settings(self, wildcards: Wildcards) -> dict[str, Any]:
        """The settings of the recordings of a batch, by their names."""
        names = self.config.batches[wildcards.batch]
        return {name: to_json(self.config.datasets[name]) for name in names}

    def batch_memory(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """MB of the job of a batch: those of its largest recording."""
        names = self.config.batches[wildcards.batch]
        return max(self.memory("estimation", name, threads, attempt) for name in names)

    def batch_time(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """Minutes of the job of a batch: a margin for all, and what each recording may take."""
        names = self.config.batches[wildcards.batch]
        margin = attempt * resources.MARGIN_MINUTES
        own = (self.time("estimation", name, None, threads, attempt) - margin for name in names)
        return margin + sum(own)

    def unfinished(self, batches: Iterable[str], code: str) -> set[str]:
        """Names of the recordings of batches that their jobs would identify."""
        return {
            name
            for batch in batches
            for name in self.config.batches[batch]
            if not is_finished(DatasetFiles.of_dataset(name), self.config.datasets[name], code)
        }

    def memory(self, demand: Demand, dataset: str, threads: int, attempt: int) -> int:
        """MB of a job."""
        settings = self.config.datasets[dataset]
        if demand == "small":
            return 500
        if demand == "reading" or (demand == "model" and not resources.estimates_again(settings)):
            return resources.reading_memory(settings, attempt)
        return resources.estimation_memory(settings, threads, attempt)

    def time(
        self, demand: Demand, dataset: str, phase: str | None, threads: int, attempt: int
    ) -> int:
        """Minutes of a job."""
        settings = self.config.datasets[dataset]
        if demand == "small":
            return 5
        if demand == "reading" or (demand == "model" and not resources.estimates_again(settings)):
            return resources.reading_time(settings, attempt)
        per_job = self.config.run.candidates_per_job if demand == "estimation" else 1
        phase = "joint" if demand == "model" else phase
        return resources.estimation_time(settings, phase, per_job, threads, attempt)


def _numbered(name: str, number: int) -> str:
    return name if number == 1 else f"{name}_{number}"
