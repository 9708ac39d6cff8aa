"""What rules ask of a configuration: stages with their files, arguments and resources.

A rule gives these methods to Snakemake, which calls them with the wildcards of each job.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from evopem.config.configuration import (
    MARGIN_MINUTES,
    Configuration,
    estimation_memory,
    estimation_time,
    is_file,
    reading_memory,
    reading_time,
)
from evopem.config.settings import DatasetSettings
from evopem.config.source_checks import RESERVED_NAMES
from evopem.files.json_form import to_json
from evopem.pipeline.planning.stage import Stage, StageJob
from evopem.pipeline.planning.stages import PREPARING, STAGES, WHOLE, results_of, stages_of
from evopem.results.identity import incompleteness, is_finished, was_read_from
from evopem.results.layout import BATCH_CHECKSUMS, DatasetFiles, lists_of

_RESERVED = "|".join(map(re.escape, RESERVED_NAMES))
DATASET_PATTERN = rf"(?!(?:{_RESERVED})/)[A-Za-z0-9][A-Za-z0-9_.-]*"
"""The form of a data set's name. A folder with a reserved name belongs to no data set."""

LIST = "report:collect_fleet"  # the function that lists all data sets

FILES = DatasetFiles.of_dataset("{dataset}")
"""The files of a data set, with the wildcard in their paths."""

Wildcards = Any  # the wildcards of a job: ``dataset``, or ``batch``, and those of its stage


@dataclass(frozen=True)
class Provider:
    """The configuration of a run, as its rules read it."""

    config: Configuration

    @cached_property
    def rules(self) -> list[StageRule]:
        """One rule for each stage, or for all of them where a job takes a recording through all.

        The outputs of a rule may not depend on the data set: where they differ, there are several
        rules, with numbers behind the name.
        """
        members: dict[tuple[str, tuple[str, ...]], list[str]] = {}
        for dataset, settings in self.config.datasets.items():
            for stage, made in self._made(settings):
                members.setdefault((stage.name, tuple(made)), []).append(dataset)
        rules: list[StageRule] = []
        for stage in (WHOLE, *STAGES):
            sets = [(made, names) for (name, made), names in members.items() if name == stage.name]
            for number, (outputs, names) in enumerate(sets, start=1):
                name = stage.name if number == 1 else f"{stage.name}_{number}"
                rules.append(StageRule(self, name, stage, frozenset(names), list(outputs)))
        return rules

    def _made(self, settings: DatasetSettings) -> Iterator[tuple[Stage, list[str]]]:
        """The stages of a data set, with their outputs as paths with wildcards."""
        if self.config.run.one_job_per == "recording":
            yield WHOLE, results_of(settings, FILES, self.with_report)
            return
        for stage in stages_of(settings, self.with_report):
            wildcards = {wildcard: f"{{{wildcard}}}" for wildcard in stage.wildcards}
            made = StageJob(stage, settings, FILES, wildcards, self.config.run).made
            if made:
                yield stage, sorted(made)

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
        lists = lists_of(self.config.following)
        return [*lists] if several or any(map(is_file, lists)) else []

    @property
    def setups(self) -> dict[str, tuple[str, ...]]:
        """The set-ups of each structure, all of which are here."""
        given, known = self.config.run.setups or {}, self.config.datasets.keys()
        return {structure: names for structure, names in given.items() if known >= set(names)}

    def with_whole_results(self) -> Provider:
        """The same for the data sets whose results are whole; standard error names the others."""
        whole = {}
        for name, settings in self.config.datasets.items():
            fault = incompleteness(DatasetFiles.of_dataset(name), self.results(name))
            if fault is None:
                whole[name] = settings
            else:
                sys.stderr.write(f"{name} is left out of the report: {fault.problem}\n")
        return Provider(replace(self.config, datasets=whole))

    @property
    def targets(self) -> list[str]:
        """What a run makes, apart from the lists of all data sets."""
        made = [result for name in self.config.datasets for result in self.results(name)]
        return self.batch_checksums or made

    @property
    def batch_checksums(self) -> list[str]:
        """The outputs of the jobs of all batches."""
        return [BATCH_CHECKSUMS.format(batch=batch) for batch in self.config.batches]

    def results(self, dataset: str) -> list[str]:
        """The results of one data set, those that other jobs read among them.

        Snakemake does not make a missing file again that only finished jobs needed. All are asked
        for, so that whatever was deleted is made again.
        """
        files = DatasetFiles.of_dataset(dataset)
        if self.config.batches:
            return files.batch_results
        return results_of(self.config.datasets[dataset], files, self.with_report)

    @property
    def last_results(self) -> list[str]:
        """What the lists of all data sets wait for: an output of each last job, and the summaries.

        The results of a batch are no outputs of Snakemake's jobs.
        """
        if self.config.batches:
            return self.batch_checksums
        last = {name: [FILES.summary] for name in self.config.datasets}
        if self.config.run.one_job_per == "stage":
            for name, settings in self.config.datasets.items():
                last_result = FILES.modes if settings.channels.frequency else FILES.spectrum
                last[name].append(FILES.report if self.with_report else last_result)
        return [path.format(dataset=name) for name, paths in last.items() for path in paths]

    def one_of(self, names: Iterable[str]) -> str:
        """A wildcard constraint that matches these names and no other data set's.

        Where these are all data sets, the form of a name suffices: a list of thousands would be
        tried for each of thousands of files.
        """
        values = set(names)
        if len(values) == len(self.config.datasets):
            return DATASET_PATTERN
        return "|".join(map(re.escape, sorted(values))) or "(?!)"

    def batch_files(self, wildcards: Wildcards) -> list[str]:
        """The recorded files of a batch that exist: the job of a batch knows what it has read."""
        return [
            path
            for settings in self._batch(wildcards).values()
            for path in settings.source.all_files
            if is_file(path)
        ]

    def batch_settings(self, wildcards: Wildcards) -> dict[str, Any]:
        """The settings of the recordings of a batch, by their names."""
        return {name: to_json(settings) for name, settings in self._batch(wildcards).items()}

    def batch_memory(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """MB of the job of a batch: those of its largest recording."""
        batch = self._batch(wildcards)
        return max(estimation_memory(settings, threads, attempt) for settings in batch.values())

    def batch_time(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """Minutes of the job of a batch: a margin for all, and what each recording may take."""
        margin, per_job = attempt * MARGIN_MINUTES, self.config.run.candidates_per_job
        batch = self._batch(wildcards).values()
        return margin + sum(
            estimation_time(s, None, per_job, threads, attempt) - margin for s in batch
        )

    def _batch(self, wildcards: Wildcards) -> dict[str, DatasetSettings]:
        return {name: self.config.datasets[name] for name in self.config.batches[wildcards.batch]}

    def unfinished(self, batches: Iterable[str], code: str) -> set[str]:
        """Names of the recordings of batches that their jobs would identify."""
        return {
            name
            for batch in batches
            for name in self.config.batches[batch]
            if not is_finished(DatasetFiles.of_dataset(name), self.config.datasets[name], code)
        }


@dataclass(frozen=True)
class StageRule:
    """A rule: what runs a stage, or all of them, for each data set that has it."""

    provider: Provider
    name: str
    stage: Stage
    members: frozenset[str]  # names of the data sets
    outputs: list[str]  # paths with wildcards

    @property
    def datasets(self) -> str:
        """A constraint of the wildcard to the data sets that the rule is for."""
        return self.provider.one_of(self.members)

    @property
    def priority(self) -> int:
        """What is read and prepared comes first, so that a bad recording ends before any search.

        Then data sets come to their end one after the other, not all at once.
        """
        names = [stage.name for stage in (WHOLE, *STAGES)]
        return 1000 if self.stage.name in PREPARING else names.index(self.stage.name)

    def recorded(self, wildcards: Wildcards) -> list[str]:
        """The recorded files that a job reads.

        A missing file is no input before its first reading: its job then says so in a sentence,
        and the other data sets continue, where Snakemake would stop them all. One that was read
        before stays an input, so that nothing made from it is lost.
        """
        files = DatasetFiles.of_dataset(wildcards.dataset)
        infos = {"files": files.recording_info, "validation_files": files.validation_recording_info}
        source = self.provider.config.datasets[wildcards.dataset].source
        return [
            path
            for key in self.stage.recorded
            for path in getattr(source, key, ())
            if is_file(path) or was_read_from(path, infos[key])
        ]

    @property
    def is_parallel(self) -> bool:
        """Whether a job estimates candidates on several cores."""
        return self.stage.is_part or self.stage is WHOLE

    def inputs(self, wildcards: Wildcards) -> list[str]:
        """The results that a job reads."""
        return self._job(wildcards).read

    def modules(self, wildcards: Wildcards) -> list[Path]:
        """The modules whose code a job runs."""
        settings = self.provider.config.datasets[wildcards.dataset]
        if self.stage is WHOLE:
            return modules_of([settings], self.provider.with_report)
        return [self.stage.module]

    def arguments(self, wildcards: Wildcards) -> Any:
        """What a job is given of the settings."""
        return self._job(wildcards).arguments

    def memory(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """MB that a job asks for."""
        settings = self.provider.config.datasets[wildcards.dataset]
        if self._only_reads(settings):
            return reading_memory(settings, attempt)
        return estimation_memory(settings, threads, attempt)

    def time(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """Minutes that a job asks for."""
        settings, run = self.provider.config.datasets[wildcards.dataset], self.provider.config.run
        if self._only_reads(settings):
            return reading_time(settings, attempt)
        demand, phase = self.stage.demand, wildcards.get("phase")
        if demand == "model" and settings.automatic is None:
            phase = "plant"  # one descent of the largest candidate
        per_job = run.candidates_per_job if demand == "estimation" else 1
        return estimation_time(settings, phase, per_job, threads, attempt)

    def _only_reads(self, settings: DatasetSettings) -> bool:
        # Of the chapter's recipe the model is there, unless focus or constraints change it.
        is_made = settings.automatic is None and not settings.fit.changes_model
        return self.stage.demand == "reading" or (self.stage.demand == "model" and is_made)

    def _job(self, wildcards: Wildcards) -> StageJob:
        values = {name: wildcards.get(name) or "" for name in self.stage.wildcards}
        config = self.provider.config
        return StageJob(self.stage, config.datasets[wildcards.dataset], FILES, values, config.run)


def modules_of(datasets: Iterable[DatasetSettings], with_report: bool) -> list[Path]:
    """The modules with the functions of all stages of some data sets."""
    return sorted({stage.module for d in datasets for stage in stages_of(d, with_report)})
