"""What rules ask of a configuration: settings, inputs and resources for their wildcards.

A rule gives these methods to Snakemake, which calls them with the wildcards of each job. Nothing
here imports numpy, pandas or Snakemake.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from evopem.config import resources
from evopem.config.configuration import Configuration
from evopem.config.dataset_names import RESERVED_NAMES
from evopem.config.order_grid import phases_of_dataset
from evopem.config.settings import (
    DatasetSettings,
    RecordedSource,
)
from evopem.config.state_space_settings import (
    MultichannelDataset,
    MultichannelSource,
    searched_variants,
    variant_name,
)
from evopem.files.json_form import to_json
from evopem.pipeline.planning.automatic import AutomaticRecipe
from evopem.pipeline.planning.batches import Batches
from evopem.pipeline.planning.job_resources import JobResources
from evopem.pipeline.planning.multichannel import SeveralChannels, other_purposes
from evopem.pipeline.planning.order_search import OrderSearch
from evopem.pipeline.planning.wildcards import FILES, Wildcards
from evopem.results.layout import BATCH_CHECKSUMS, OVERVIEW, DatasetFiles
from evopem.results.replaced_recordings import was_read_from

_Dataset = DatasetSettings | MultichannelDataset
_RESERVED = "|".join(map(re.escape, RESERVED_NAMES))
DATASET_PATTERN = rf"(?!(?:{_RESERVED})/)[A-Za-z0-9][A-Za-z0-9_.-]*"
"""The form of a data set's name. A folder with a reserved name belongs to no data set."""

RECORDED_FILES = {
    "synthetic": (),
    "recorded": ("file",),
    "validated": ("file", "validation_file"),
}
"""The keys of the recorded files of a data set, by its source."""


def _structure_of(dataset: _Dataset) -> str:
    """The structure on which the results depend, with the automatic recipe before it."""
    if isinstance(dataset, MultichannelDataset):
        forms = "_".join(variant_name(*each) for each in searched_variants(dataset))
        return "_".join(["state_space", forms, *other_purposes(dataset)])
    automatic = dataset.automatic
    if automatic is None:
        return dataset.order_grid.structure
    purpose = "" if automatic.other_purpose == "prediction" else f"_{automatic.purpose}"
    return f"automatic{purpose}_{automatic.structure}".removesuffix("_None")


@dataclass(frozen=True)
class Kind:
    """Data sets with the same recorded files and results: one rule can identify them.

    Attributes
    ----------
    name : str
        Source and structure, such as ``recorded_armax``.
    members : frozenset of str
        Names of the data sets.
    recorded : tuple of str
        Keys of the recorded files.
    results : list of str
        Paths with the wildcard of the data set.
    script : str
        Name of the script that makes them.
    """

    name: str
    members: frozenset[str]
    recorded: tuple[str, ...]
    results: list[str]
    script: str


@dataclass(frozen=True)
class Provider:
    """The configuration of a run, as its rules read it."""

    config: Configuration

    @cached_property
    def order_search(self) -> OrderSearch:
        """What rules ask about the search over orders by the recipe of the chapter."""
        return OrderSearch(self.config)

    @cached_property
    def automatic_recipe(self) -> AutomaticRecipe:
        """What rules ask about the automatic recipe."""
        return AutomaticRecipe(self.config)

    @cached_property
    def several_channels(self) -> SeveralChannels:
        """What rules ask about data sets with several channels."""
        return SeveralChannels(self.config)

    @cached_property
    def batches(self) -> Batches:
        """What the rule of a batch of recordings asks."""
        return Batches(self.config)

    @cached_property
    def resources(self) -> JobResources:
        """Memory and time of jobs."""
        return JobResources(self.config)

    @cached_property
    def recorded(self) -> frozenset[str]:
        """Names of the data sets that are read from a file."""
        return frozenset(
            name
            for name, dataset in self.config.datasets.items()
            if isinstance(dataset.source, RecordedSource | MultichannelSource)
        )

    @cached_property
    def validated(self) -> frozenset[str]:
        """Names of the data sets with an independent recording for validation."""
        return frozenset(name for name in self.recorded if self._files(name, "validation_file"))

    @cached_property
    def synthetic(self) -> frozenset[str]:
        """Names of the data sets that are simulated."""
        return frozenset(self.config.datasets) - self.recorded

    @cached_property
    def automatic(self) -> frozenset[str]:
        """Names of the data sets of the automatic recipe."""
        datasets = self.config.single_channel.items()
        return frozenset(name for name, dataset in datasets if dataset.automatic is not None)

    @cached_property
    def single_channel(self) -> frozenset[str]:
        """Names of the data sets with one input and one output, or an output alone."""
        return frozenset(self.config.single_channel)

    @cached_property
    def multichannel(self) -> frozenset[str]:
        """Names of the data sets with several channels."""
        return frozenset(self.config.multichannel)

    @property
    def variants(self) -> frozenset[str]:
        """Names of the forms with their weightings that any data set searches."""
        datasets = self.config.multichannel.values()
        return frozenset(variant_name(*each) for own in datasets for each in searched_variants(own))

    @cached_property
    def by_chapter(self) -> frozenset[str]:
        """Names of the data sets of the chapter's recipe."""
        return self.single_channel - self.automatic

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

        Parameters
        ----------
        dataset : str
        files : DatasetFiles, optional
            The paths, by default with the name of the data set in them.
        """
        own = files or DatasetFiles.of_dataset(dataset)
        if self.config.batches:
            return own.batch_results
        truth = [own.truth] if dataset in self.synthetic else []
        validation = (
            [own.validation_recording, own.validation_recording_info]
            if dataset in self.validated
            else []
        )
        settings = self.config.datasets[dataset]
        if isinstance(settings, MultichannelDataset):
            names = [variant_name(*each) for each in searched_variants(settings)]
            report = [own.report] if self.with_report else []
            other = [
                file
                for purpose in other_purposes(settings)
                for file in (own.other_model(purpose), own.other_errors(purpose))
            ]
            return [*validation, *own.state_space_results(names), *other, *report]
        phases = [own.phase(each) for each in phases_of_dataset(settings)]
        decisions = (
            [] if settings.automatic is None else self.automatic_recipe.files_of(dataset, own)
        )
        read = [own.recording, *validation, own.prepared, *phases, *decisions]
        return [*read, *own.results, *(own.pages if self.with_report else []), *truth]

    @property
    def kinds(self) -> list[Kind]:
        """The data sets, divided into kinds whose recorded files and results are the same ones."""
        members: dict[tuple[str, str], list[str]] = {}
        for name, dataset in self.config.datasets.items():
            source = "recorded" if name in self.recorded else "synthetic"
            source = "validated" if name in self.validated else source
            members.setdefault((source, _structure_of(dataset)), []).append(name)
        return [
            Kind(
                name=f"{source}_{structure}",
                members=frozenset(names),
                recorded=RECORDED_FILES[source],
                results=self.results(names[0], FILES),
                script="identify_channels"
                if names[0] in self.multichannel
                else "identify_recording",
            )
            for (source, structure), names in members.items()
        ]

    @property
    def last_results(self) -> list[str]:
        """The results that no other job of a data set needs, apart from its summary.

        Where one job makes all results of a data set, none; of batches the outputs of their jobs.
        """
        if self.config.run.one_job_per == "recording":
            return self.batch_checksums
        return (
            [
                result
                for own in map(DatasetFiles.of_dataset, self.config.single_channel)
                for result in (
                    own.config,
                    own.candidates,
                    *([own.report] if self.with_report else []),
                )
            ]
            + [
                result
                for own in map(DatasetFiles.of_dataset, self.config.multichannel)
                for result in (
                    own.config,
                    own.decisions,
                    *([own.report] if self.with_report else []),
                )
            ]
            + [DatasetFiles.of_dataset(name).decisions for name in sorted(self.automatic)]
        )

    def one_of(self, names: frozenset[str]) -> str:
        """A wildcard constraint that matches these names and no other data set's.

        Where these are all data sets, the form of a name suffices: a list of thousands would be
        tried for each of thousands of files.
        """
        if len(names) == len(self.config.datasets):
            return DATASET_PATTERN
        return "|".join(map(re.escape, sorted(names))) or "(?!)"

    def settings(self, part: str = "") -> Callable[[Wildcards], Any]:
        """A function that gives a part of the settings of a data set, or all of them.

        Parameters
        ----------
        part : str
            Names of attributes with dots between them, such as ``preparation.transforms``.
        """

        def provide(wildcards: Wildcards) -> Any:
            provided: Any = self.config.datasets[wildcards.dataset]
            for name in filter(None, part.split(".")):
                provided = getattr(provided, name)
            return to_json(provided)

        return provide

    def recorded_files(self, key: str) -> Callable[[Wildcards], dict[str, list[str]]]:
        """A function that gives the recorded files that a data set names under a key.

        A missing file is no input before its first reading: its job then says so in a sentence,
        and the other data sets continue, where Snakemake would stop them all. One that was read
        before stays an input, so that nothing made from it is lost.
        """

        def existing(wildcards: Wildcards) -> dict[str, list[str]]:
            own = DatasetFiles.of_dataset(wildcards.dataset)
            info = own.recording_info if key == "file" else own.validation_recording_info
            used = [
                path
                for path in self._files(wildcards.dataset, key)
                if resources.is_file(path) or was_read_from(path, info)
            ]
            return {key: used} if used else {}

        return existing

    def recorded_names(self, wildcards: Wildcards) -> list[str]:
        """The recorded files of a data set, those for validation last, as they are written."""
        return list(self.config.datasets[wildcards.dataset].source.all_files)

    def told_channels(self, wildcards: Wildcards) -> dict[str, str]:
        """The origin of the estimation recording, where it tells the channels of the others."""
        source = self._of(wildcards).source
        told = isinstance(source, RecordedSource) and source.channels_from_file
        return {"info": FILES.recording_info} if told else {}

    def validation_recording(self, file: str) -> Callable[[Wildcards], dict[str, str]]:
        """A function that gives a file of the validation recording, where there is one."""

        def existing(wildcards: Wildcards) -> dict[str, str]:
            return {"validation_recording": file} if wildcards.dataset in self.validated else {}

        return existing

    def truth(self, wildcards: Wildcards) -> dict[str, str]:
        """The truth behind a synthetic data set."""
        return {"truth": FILES.truth} if wildcards.dataset in self.synthetic else {}

    def _of(self, wildcards: Wildcards) -> DatasetSettings:
        return self.config.single_channel[wildcards.dataset]

    def _files(self, name: str, key: str) -> tuple[str, ...]:
        paths: tuple[str, ...] = getattr(self.config.datasets[name].source, f"{key}s")
        return paths
