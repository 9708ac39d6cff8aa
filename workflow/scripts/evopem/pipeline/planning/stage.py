"""What a stage is: the function that a job calls, with its files and arguments.

Nothing here imports numpy, pandas or Snakemake.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal

from evopem.config.structures import AUTOMATIC_STRUCTURES
from evopem.pipeline.planning.stage_lists import ARGUMENTS, LISTS, Task, Value, attribute

Demand = Literal["reading", "model", "estimation"]

_WORD = re.compile(r"{(\w+)}")


@dataclass(frozen=True)
class Stage:
    """What one job does: the function that it calls, and the files that this reads and writes."""

    name: str  # that of its rule
    function: str  # module below ``evopem.pipeline`` and name, with a colon between them
    title: str  # what the stage does, in words; it may hold wildcards
    applies: str = ""  # a condition of :func:`holds`, of the data sets that have the stage
    # inputs, outputs: attributes of :class:`.DatasetFiles`, with the argument of a method behind a
    # colon. Words in braces are wildcards or keys of :data:`LISTS`, which stand for several files
    # or none.
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


def paths(name: str, task: Task) -> list[str]:
    """The paths that an entry of a stage's inputs or outputs stands for."""
    attribute, _, argument = name.partition(":")
    if attribute.startswith("{"):
        return [path for each in LISTS[attribute[1:-1]](task) for path in paths(each, task)]
    value = getattr(task.files, attribute)
    if not argument:
        return list(value) if isinstance(value, list) else [value]
    keys = [key for key in _WORD.findall(argument) if key in LISTS]
    listed = [LISTS[key](task) for key in keys]
    return [
        value(*argument.format(**task.values, **dict(zip(keys, each, strict=True))).split(","))
        for each in product(*listed)
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
