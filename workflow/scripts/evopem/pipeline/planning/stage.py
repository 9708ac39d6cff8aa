"""What a stage is: the function that a job calls, with its files and arguments.

Nothing here imports numpy, pandas or Snakemake.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal

from evopem.config import order_grid
from evopem.config.configuration import RunSettings
from evopem.config.settings import AutomaticSettings, DatasetSettings, OrderGrid
from evopem.config.structures import (
    AUTOMATIC_STRUCTURES,
    is_polynomial,
    searched_forms,
)
from evopem.pipeline.planning.constraint_plan import known_rate
from evopem.results.layout import DatasetFiles

Demand = Literal["reading", "model", "estimation"]

_WORD = re.compile(r"{(\w+)}")


@dataclass(frozen=True)
class Task:
    """One job: a stage of a data set, with values of the stage's own wildcards."""

    settings: DatasetSettings
    files: DatasetFiles
    # Of the wildcards by their names, such as ``{"structure": "oe"}``
    values: Mapping[str, str] = field(default_factory=dict)
    run: RunSettings = field(default_factory=RunSettings)


def attribute(settings: DatasetSettings, path: str) -> Any:
    """An attribute of settings by its path, such as ``source.files``; themselves for none."""
    value: Any = settings
    for name in filter(None, path.split(".")):
        value = getattr(value, name)
    return value


def holds(condition: str, settings: DatasetSettings) -> bool:
    """Whether an attribute of settings is there and not empty; with ``not`` before it the reverse.

    ``automatic``: structure and orders are decided, and not searched phase by phase.
    ``is_single_channel``: the model is one of polynomials with at most one input, and one output.
    ``source.all_files``: the recording is read, and not simulated.
    """
    path = condition.removeprefix("not ")
    return bool(attribute(settings, path)) == (path == condition)


def wanted(task: Task) -> tuple[str, ...]:
    """The structures that may be chosen; others are searched for their models as starts."""
    structure, searched = automatic(task).structure, searched_forms(task.settings)
    return (structure,) if structure in searched else searched


def _nested(task: Task) -> tuple[str, ...]:
    """The structures whose models are starts of a search."""
    nested = AUTOMATIC_STRUCTURES.get(task.values["structure"], ())
    return tuple(each for each in nested if each in searched_forms(task.settings))


def purposes(task: Task) -> tuple[str, ...]:
    """The purpose whose model is kept beside that of the configuration; none without inputs."""
    kept = task.settings.automatic and task.settings.channels.inputs
    return (automatic(task).other_purpose,) if kept else ()


def _part_count(task: Task) -> int:
    """How many jobs the candidates of a phase are divided into."""
    grid, per_job = task.settings.order_grid, task.run.candidates_per_job
    return order_grid.part_count(task.values["phase"], grid, per_job)


def automatic(task: Task) -> AutomaticSettings:
    """The settings of the automatic recipe; of the chapter's the built-in ones."""
    return task.settings.automatic or AutomaticSettings()


def _previous(task: Task) -> list[str]:
    structure = task.settings.order_grid.structure
    previous = order_grid.previous_phase(task.values["phase"], structure)
    return [previous] if previous else []


def _resonances(task: Task) -> list[str]:
    needed = order_grid.needs_resonances(task.values["phase"], task.settings.order_grid)
    return ["spectrum_summary"] if needed else []


LISTS: Mapping[str, Callable[[Task], Sequence[str]]] = {
    "structures": lambda task: searched_forms(task.settings),
    "wanted": wanted,
    "nested": _nested,
    "purposes": purposes,
    "phases": lambda task: order_grid.phases_of_dataset(task.settings),
    "last": lambda task: order_grid.phases_of_dataset(task.settings)[-1:],
    "parts": lambda task: [str(number + 1) for number in range(_part_count(task))],
    "previous": _previous,
    "resonances": _resonances,
}
"""What words in the inputs and outputs of stages stand for."""


def _of_chapter(given: Callable[[DatasetSettings], object]) -> Callable[[Task], object]:
    """What the chapter's recipe is given of the settings."""
    return lambda task: None if task.settings.automatic else given(task.settings)


def fit_to_check(task: Task) -> object:
    """Constraints and order grid, where constraints in Hz wait for the sampling rate."""
    settings = task.settings
    given = settings.automatic is None and settings.fit.constraints is not None
    waits = given and known_rate(settings) is None
    return (settings.fit, settings.order_grid) if waits else None


def grid(of_phase: Callable[[str, OrderGrid], OrderGrid]) -> Callable[[Task], OrderGrid]:
    """What the candidates of a phase, or the selection among them, depend on of the order grid."""
    return lambda task: of_phase(task.values["phase"], task.settings.order_grid)


def choices(*names: str) -> Callable[[Task], AutomaticSettings]:
    """Some settings of the automatic recipe, the others built in."""
    return lambda task: AutomaticSettings(
        **{name: getattr(automatic(task), name) for name in names}
    )


def orders_of_structure(task: Task) -> AutomaticSettings:
    """The ranges that the search over the orders of a structure depends on."""
    orders = automatic(task).orders
    polynomial = is_polynomial(task.values["structure"])
    return AutomaticSettings(orders=orders.of_polynomials if polynomial else orders.of_states)


def _fits(task: Task) -> dict[str, object]:
    """What fits of several channels have in common; those of one channel depend on nothing."""
    common: dict[str, object] = {"objective": "quadratic", "level": True}
    search, own = task.settings.search, automatic(task)
    if task.settings.is_single_channel:
        return common | {"weighting": None, "max_root_radius": 0.9999, "seed": 1}
    radius, seed = search.max_root_radius, search.seed
    return common | {"weighting": own.weighting, "max_root_radius": radius, "seed": seed}


Value = str | Callable[[Task], Any]
"""An argument of a stage: the path of an attribute of the settings, or what computes it."""

ARGUMENTS: Mapping[str, Value] = {
    "told": "source.channels_from_file",
    "is_validated": lambda task: holds("source.validation_files", task.settings),
    "given": lambda task: task.settings.automatic and task.settings.automatic.preparation,
    "requirements": _of_chapter(order_grid.sample_requirements),
    "nested": _nested,
    "structures": LISTS["structures"],
    "phases": LISTS["phases"],
    "parts": _part_count,
    "window": _of_chapter(order_grid.scoring_window),
    "fits": _fits,
}
"""Arguments that are the same in every stage; others of their names are attributes of settings."""


@dataclass(frozen=True)
class Stage:
    """What one job does: the function that it calls, and the files that this reads and writes."""

    name: str  # that of its rule
    function: str  # module below ``evopem.pipeline`` and name, with a colon between them
    title: str  # what the stage does, in words; it may hold wildcards
    applies: str = ""  # a condition of :func:`holds`, of the data sets that have the stage
    # inputs, outputs: attributes of :class:`.DatasetFiles`, with the argument of a method behind a
    # colon, and a condition behind `` if ``. Words in braces are wildcards or keys of
    # :data:`LISTS`, which stand for several files or none.
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    # Arguments of the function, exactly the settings that the results depend on: names of
    # :data:`ARGUMENTS` or of settings, and others by their names
    given: tuple[str, ...] = ()
    settings: Mapping[str, Value] = field(default_factory=dict)
    # For each wildcard of the outputs, the list of :data:`LISTS` that holds its values
    wildcards: Mapping[str, str] = field(default_factory=dict)
    # Attributes of the source that hold recorded files which the stage reads
    recorded: tuple[str, ...] = ()
    demand: Demand = "reading"  # how memory and time grow with the recording
    is_page: bool = False  # whether it belongs to the report
    is_part: bool = False  # whether its outputs are parts of those of another stage

    @property
    def job(self) -> str:
        """Name of its jobs: of their logs, checksums and measured times."""
        return "/".join([self.name, *(f"{{{wildcard}}}" for wildcard in self.wildcards)])

    @property
    def module(self) -> Path:
        """The file of the module that holds its function."""
        return module_of(self.function)

    def tasks(self, task: Task) -> Iterator[Task]:
        """Every job of the stage, from a task without values of wildcards."""
        tasks = [task]
        for wildcard, listed in self.wildcards.items():
            tasks = [
                replace(each, values={**each.values, wildcard: value})
                for each in tasks
                for value in LISTS[listed](each)
            ]
        yield from tasks

    def read_by(self, task: Task) -> list[str]:
        """The results that a job reads."""
        return [path for name in self.inputs for path in paths(name, task)]

    def made_by(self, task: Task) -> list[str]:
        """The results that a job writes."""
        return [path for name in self.outputs for path in paths(name, task)]

    def arguments(self, task: Task) -> dict[str, Any]:
        """The arguments of the function that come from the settings."""
        given = {name: ARGUMENTS.get(name, name) for name in self.given}
        return {
            name: attribute(task.settings, value) if isinstance(value, str) else value(task)
            for name, value in (given | {**self.settings}).items()
        }

    def words(self, task: Task) -> str:
        """What a job does, in words."""
        shown = {name: _TITLES.get(value, value) for name, value in task.values.items()}
        return self.title.format(**shown)


def module_of(function: str) -> Path:
    """The file of the module that holds a function, which is not imported."""
    return Path(__file__).parents[1] / (function.partition(":")[0].replace(".", "/") + ".py")


def paths(entry: str, task: Task) -> list[str]:
    """The paths that an entry of a stage's inputs or outputs stands for."""
    name, _, condition = entry.partition(" if ")
    name, _, argument = name.partition(":")
    if name.startswith("{"):
        return [path for each in LISTS[name[1:-1]](task) for path in paths(each, task)]
    if not holds(condition, task.settings):
        return []
    value = getattr(task.files, name)
    if not argument:
        return list(value) if isinstance(value, list) else [value]
    keys = [key for key in _WORD.findall(argument) if key in LISTS]
    return [
        value(*argument.format(**task.values, **dict(zip(keys, each, strict=True))).split(","))
        for each in product(*(LISTS[key](task) for key in keys))
    ]


_TITLES = {
    **{name: name.upper() for name in AUTOMATIC_STRUCTURES},
    "delay": "delay",
    "joint": "joint order",
    "nc": "order of C",
    "nd": "order of D",
    "na": "order of A",
    "nb": "order of B",
}
