"""What rules ask of a configuration: settings, inputs and resources for their wildcards.

A rule gives these methods to Snakemake, which calls them with the wildcards of each job. Nothing
here imports numpy, pandas or Snakemake.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

from evopem.config import order_grid, resources
from evopem.config.configuration import Configuration
from evopem.config.dataset_names import RESERVED_NAMES
from evopem.config.order_grid import phases_of_dataset
from evopem.config.settings import (
    AutomaticSettings,
    DatasetSettings,
    OrderGrid,
    RecordedSource,
)
from evopem.config.state_space_settings import (
    StateSpaceDataset,
    StateSpaceSource,
    searched_variants,
    variant_name,
)
from evopem.config.structures import AUTOMATIC_STRUCTURES, searched_structures
from evopem.files.json_form import to_json
from evopem.pipeline.constraint_plan import known_rate
from evopem.results.layout import BATCH_CHECKSUMS, OVERVIEW, DatasetFiles
from evopem.results.made_from import is_finished
from evopem.results.replaced_recordings import was_read_from

_Dataset = DatasetSettings | StateSpaceDataset
_DECISIONS = ("preparation", "folds", "delay", "comparison", "remedies")
_RESERVED = "|".join(map(re.escape, RESERVED_NAMES))
DATASET_PATTERN = rf"(?!(?:{_RESERVED})/)[A-Za-z0-9][A-Za-z0-9_.-]*"
"""The form of a data set's name. A folder with a reserved name belongs to no data set."""

FILES = DatasetFiles.of_dataset("{dataset}")
"""The files of a data set, with the wildcard in their paths."""


RECORDED_FILES = {
    "synthetic": (),
    "recorded": ("file",),
    "validated": ("file", "validation_file"),
}
"""The keys of the recorded files of a data set, by its source."""


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
class _OfDataset:
    """The wildcards of the job of one recording, where Snakemake has planned that of a batch."""

    dataset: str
    phase: str = ""

    def get(self, name: str) -> str | None:
        """Value of a wildcard, None where the job has no such one."""
        return getattr(self, name, None) or None


def _structure_of(dataset: _Dataset) -> str:
    """The structure on which the results depend, with the automatic recipe before it."""
    if isinstance(dataset, StateSpaceDataset):
        forms = "_".join(variant_name(*each) for each in searched_variants(dataset))
        return "_".join(["state_space", forms, *_other_purposes(dataset)])
    automatic = dataset.automatic
    if automatic is None:
        return dataset.order_grid.structure
    purpose = "" if automatic.other_purpose == "prediction" else f"_{automatic.purpose}"
    return f"automatic{purpose}_{automatic.structure}".removesuffix("_None")


def _other_purposes(dataset: StateSpaceDataset) -> tuple[str, ...]:
    """The purpose whose model is kept beside that of the configuration; none without inputs."""
    if not dataset.source.channels.inputs:
        return ()
    return ("simulation" if dataset.choices.purpose == "prediction" else "prediction",)


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
    def recorded(self) -> frozenset[str]:
        """Names of the data sets that are read from a file."""
        return frozenset(
            name
            for name, dataset in self.config.datasets.items()
            if isinstance(dataset.source, RecordedSource | StateSpaceSource)
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
    def state_space(self) -> frozenset[str]:
        """Names of the data sets with several channels."""
        return frozenset(self.config.state_space)

    @property
    def variants(self) -> frozenset[str]:
        """Names of the forms with their weightings that any data set searches."""
        datasets = self.config.state_space.values()
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
        if isinstance(settings, StateSpaceDataset):
            names = [variant_name(*each) for each in searched_variants(settings)]
            report = [own.report] if self.with_report else []
            other = [
                file
                for purpose in _other_purposes(settings)
                for file in (own.other_model(purpose), own.other_errors(purpose))
            ]
            return [*validation, *own.state_space_results(names), *other, *report]
        phases = [own.phase(each) for each in phases_of_dataset(settings)]
        decisions = [] if settings.automatic is None else self._decisions(dataset, own)
        read = [own.recording, *validation, own.prepared, *phases, *decisions]
        return [*read, *own.results, *(own.pages if self.with_report else []), *truth]

    def _decisions(self, dataset: str, own: DatasetFiles) -> list[str]:
        """All files of decisions of one data set."""
        searches = [own.search(each) for each in self._structures(dataset)]
        other = self._other_purpose(dataset)
        others = [own.other_errors(other), own.other_model(other)]
        return [own.stretches, *map(own.decision, _DECISIONS), *searches, *others, own.decisions]

    def _other_purpose(self, dataset: str) -> str:
        automatic = self.config.single_channel[dataset].automatic or AutomaticSettings()
        return automatic.other_purpose

    def _structures(self, dataset: str) -> tuple[str, ...]:
        automatic = self.config.single_channel[dataset].automatic
        return searched_structures(automatic.structure if automatic else None)

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
                if names[0] in self.state_space
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
                for own in map(DatasetFiles.of_dataset, self.config.state_space)
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
        keys = ("file", "validation_file") if wildcards.dataset in self.recorded else ()
        return [path for key in keys for path in self._files(wildcards.dataset, key)]

    def batch_files(self, wildcards: BatchWildcards) -> list[str]:
        """The recorded files of a batch that exist: the job of a batch knows what it has read."""
        return [
            path
            for name in self.config.batches[wildcards.batch]
            for key in ("file", "validation_file")
            if name in self.recorded
            for path in self._files(name, key)
            if resources.is_file(path)
        ]

    def batch_settings(self, wildcards: BatchWildcards) -> dict[str, Any]:
        """The settings of the recordings of a batch, by their names."""
        names = self.config.batches[wildcards.batch]
        return {name: to_json(self.config.datasets[name]) for name in names}

    def batch_memory(self, wildcards: BatchWildcards, threads: int, attempt: int) -> int:
        """MB of the job of a batch: those of its largest recording."""
        own = map(_OfDataset, self.config.batches[wildcards.batch])
        return max(self.estimation_memory(each, threads, attempt) for each in own)

    def batch_time(self, wildcards: BatchWildcards, threads: int, attempt: int) -> int:
        """Minutes of the job of a batch: a margin for all, and what each recording may take."""
        own = map(_OfDataset, self.config.batches[wildcards.batch])
        margin = attempt * resources.MARGIN_MINUTES
        return margin + sum(self.estimation_time(each, threads, attempt) - margin for each in own)

    def unfinished(self, batches: Iterable[str], code: str) -> set[str]:
        """Names of the recordings of batches that their jobs would identify."""
        return {
            name
            for batch in batches
            for name in self.config.batches[batch]
            if not is_finished(DatasetFiles.of_dataset(name), self.config.datasets[name], code)
        }

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

    def window(self, wildcards: Wildcards) -> object:
        """The samples on which the candidates of a data set are compared.

        None for the automatic recipe, whose chosen model has its own.
        """
        if self._of(wildcards).automatic is not None:
            return None
        return to_json(order_grid.scoring_window(self._of(wildcards)))

    def requirements(self, wildcards: Wildcards) -> object:
        """What a record must have for the largest candidate of its data set."""
        return to_json(order_grid.sample_requirements(self._of(wildcards)))

    def fit_to_check(self, wildcards: Wildcards) -> object:
        """Constraints and order grid, where constraints in Hz wait for the sampling rate."""
        settings = self._of(wildcards)
        waits = settings.fit.constraints is not None and known_rate(settings) is None
        return to_json((settings.fit, settings.order_grid)) if waits else None

    def phase_grid(self, wildcards: Wildcards) -> object:
        """The part of the order grid that a phase uses."""
        grid = order_grid.grid_of_phase(wildcards.phase, self._of(wildcards).order_grid)
        return to_json(grid)

    def selection_grid(self, wildcards: Wildcards) -> object:
        """The part of the order grid that the selection of a phase uses: the delays, at its end."""
        grid = self._of(wildcards).order_grid
        refined = wildcards.phase == order_grid.DELAY_REFINED_IN
        own = OrderGrid(structure=grid.structure, level=grid.level)
        return to_json(replace(own, delay=grid.delay) if refined else own)

    def phases(self, wildcards: Wildcards) -> list[str]:
        """Names of the phases of a data set, in their order."""
        return list(phases_of_dataset(self._of(wildcards)))

    def selections(self, wildcards: Wildcards) -> list[str]:
        """The outputs of all phases of a data set."""
        return [FILES.phase(phase) for phase in self.phases(wildcards)]

    def last_selection(self, wildcards: Wildcards) -> str:
        """The output of the last phase of a data set."""
        return self.selections(wildcards)[-1]

    def phase_of_orders(self, wildcards: Wildcards) -> str:
        """The phase over whose models the modes are compared."""
        return order_grid.phase_of_orders_of(self._of(wildcards))

    def models_of_orders(self, wildcards: Wildcards) -> str:
        """The output of that phase."""
        return FILES.phase(self.phase_of_orders(wildcards))

    def part_count(self, wildcards: Wildcards) -> int:
        """The number of jobs of a phase."""
        grid, per_job = self._of(wildcards).order_grid, self.config.run.candidates_per_job
        return order_grid.part_count(wildcards.phase, grid, per_job)

    def parts(self, wildcards: Wildcards) -> list[str]:
        """The outputs of all jobs of a phase."""
        numbers = range(1, self.part_count(wildcards) + 1)
        return [FILES.part(wildcards.phase, number) for number in numbers]

    def earlier_results(self, wildcards: Wildcards) -> dict[str, str]:
        """What a phase waits for: its predecessor's selection, and the spectrum if it counts."""
        structure = self._of(wildcards).order_grid.structure
        previous = order_grid.previous_phase(wildcards.phase, structure)
        inputs = {"previous": FILES.phase(previous)} if previous else {}
        if order_grid.needs_resonances(wildcards.phase, self._of(wildcards).order_grid):
            inputs["spectrum"] = FILES.spectrum_summary
        return inputs

    def given_preparation(self, wildcards: Wildcards) -> dict[str, Any]:
        """What the configuration decides of an automatic preparation."""
        settings = self._of(wildcards)
        automatic = settings.automatic or AutomaticSettings()
        return order_grid.given_preparation(settings.preparation, automatic)

    def automatic_settings(self, *names: str) -> Callable[[Wildcards], dict[str, Any]]:
        """A function that gives some settings of the automatic recipe, the others built in."""

        def provide(wildcards: Wildcards) -> dict[str, Any]:
            own: dict[str, Any] = to_json(self._of(wildcards).automatic)
            return {name: own[name] for name in names}

        return provide

    def wanted_structures(self, wildcards: Wildcards) -> list[str]:
        """The structures among which the automatic recipe chooses."""
        automatic = self._of(wildcards).automatic
        structure = automatic.structure if automatic else None
        return [structure] if structure else list(self._structures(wildcards.dataset))

    def structures(self, wildcards: Wildcards) -> list[str]:
        """The structures that the automatic recipe searches."""
        return list(self._structures(wildcards.dataset))

    def other_purpose(self, wildcards: Wildcards) -> str:
        """The other purpose for which the automatic recipe keeps a model."""
        return self._other_purpose(wildcards.dataset)

    def other_errors(self, wildcards: Wildcards) -> str:
        """What the model for this purpose reaches."""
        return FILES.other_errors(self.other_purpose(wildcards))

    def wanted_searches(self, wildcards: Wildcards) -> list[str]:
        """The outputs of the searches of these structures."""
        return [FILES.search(each) for each in self.wanted_structures(wildcards)]

    def searches(self, wildcards: Wildcards) -> list[str]:
        """The outputs of the searches of all structures."""
        return [FILES.search(each) for each in self.structures(wildcards)]

    def nested_searches(self, wildcards: Wildcards) -> list[str]:
        """The outputs of the searches whose optima a structure's search starts from."""
        nested = AUTOMATIC_STRUCTURES[str(wildcards.get("structure"))]
        return [FILES.search(each) for each in nested]

    def chosen(self, wildcards: Wildcards) -> dict[str, str]:
        """What the completed model of an automatic recipe is described by."""
        if self._of(wildcards).automatic is None:
            return {}
        return {"plan": FILES.decision("preparation"), "remedies": FILES.decision("remedies")}

    def decisions(self, wildcards: Wildcards) -> dict[str, str]:
        """The decisions of an automatic recipe, for its report."""
        if self._of(wildcards).automatic is None:
            return {}
        return {"decisions": FILES.decisions}

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
        if wildcards.dataset in self.state_space:
            return self.state_space_memory(wildcards, attempt)
        return resources.estimation_memory(self._of(wildcards), threads, attempt)

    def estimation_time(self, wildcards: Wildcards, threads: int, attempt: int) -> int:
        """Minutes of a job that estimates the candidates of a phase, or of all of them."""
        if wildcards.dataset in self.state_space:
            return self.state_space_time(wildcards, attempt)
        return resources.estimation_time(
            self._of(wildcards),
            wildcards.get("phase"),
            self.config.run.candidates_per_job,
            threads,
            attempt,
        )

    def searched_variants(self, wildcards: Wildcards) -> list[tuple[str, str]]:
        """The forms with their weightings that a data set with several channels searches."""
        return list(searched_variants(self.config.state_space[wildcards.dataset]))

    def order_ranges(self, wildcards: Wildcards) -> Any:
        """Ranges of the orders of the variant that a job searches."""
        choices = self.config.state_space[wildcards.dataset].choices
        return to_json(choices.orders.of_form(wildcards.get("variant") or ""))

    def variant_searches(self, wildcards: Wildcards) -> list[str]:
        """The outputs of their searches."""
        return [FILES.search(variant_name(*each)) for each in self.searched_variants(wildcards)]

    def models_of_orders_of_variants(self, wildcards: Wildcards) -> list[str]:
        """The models of all orders that these searches leave."""
        names = [variant_name(*each) for each in self.searched_variants(wildcards)]
        return [FILES.models_of_orders(name) for name in names]

    def other_state_space(self, wildcards: Wildcards) -> list[str]:
        """What the model for the other purpose reaches; nothing without inputs."""
        own = self.config.state_space[wildcards.dataset]
        return [FILES.other_errors(purpose) for purpose in _other_purposes(own)]

    def start_and_rate_given(self, wildcards: Wildcards) -> tuple[bool, bool]:
        """Whether the configuration says where samples begin, and at which rate."""
        own = self.config.state_space[wildcards.dataset]
        return bool(own.split.discard), own.rate_given

    def state_space_memory(self, wildcards: Wildcards, attempt: int) -> int:
        """MB of a job that estimates models of several channels."""
        return resources.state_space_memory(self.config.state_space[wildcards.dataset], attempt)

    def state_space_time(self, wildcards: Wildcards, attempt: int) -> int:
        """Minutes of a job that estimates models of several channels."""
        return resources.state_space_time(self.config.state_space[wildcards.dataset], attempt)

    def _of(self, wildcards: Wildcards) -> DatasetSettings:
        return self.config.single_channel[wildcards.dataset]

    def _files(self, name: str, key: str) -> tuple[str, ...]:
        paths: tuple[str, ...] = getattr(self.config.datasets[name].source, f"{key}s")
        return paths
