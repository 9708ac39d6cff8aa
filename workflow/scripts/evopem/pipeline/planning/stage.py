"""What a stage is, and one job of it: the function that it calls, with files and arguments."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

from evopem.config import order_grid
from evopem.config.configuration import RunSettings
from evopem.config.settings import AutomaticSettings, DatasetSettings, OrderGrid, OrderRanges
from evopem.config.structures import NESTED, STRUCTURES, is_polynomial, searched_forms
from evopem.files.json_form import to_json
from evopem.pipeline.call import Log, call
from evopem.pipeline.planning.constraint_plan import known_rate
from evopem.results.layout import DatasetFiles

Demand = Literal["reading", "model", "estimation"]

_WORD = re.compile(r"{(\w+)}")


@dataclass(frozen=True)
class StageJob:
    """One job: a stage of a data set, with values of the stage's own wildcards."""

    stage: Stage
    settings: DatasetSettings
    files: DatasetFiles
    # Of the wildcards by their names, such as ``{"structure": "oe"}``
    values: Mapping[str, str] = field(default_factory=dict)
    of_run: RunSettings = field(default_factory=RunSettings)

    @property
    def name(self) -> str:
        """Name of the stage, and the values behind it."""
        return "/".join([self.stage.name, *self.values.values()])

    @property
    def read(self) -> list[str]:
        """The results that it reads."""
        return [path for name in self.stage.inputs for path in paths(name, self)]

    @property
    def made(self) -> list[str]:
        """The results that it writes."""
        return [path for name in self.stage.outputs for path in paths(name, self)]

    @property
    def arguments(self) -> Any:
        """The arguments of its function that come from the settings, as JSON."""
        given = {name: ARGUMENTS.get(name, name) for name in self.stage.given}
        return to_json(
            {
                name: attribute(self.settings, value) if isinstance(value, str) else value(self)
                for name, value in (given | {**self.stage.settings}).items()
            }
        )

    @property
    def words(self) -> str:
        """What it does, in words."""
        shown = {name: _TITLES.get(value, value) for name, value in self.values.items()}
        return self.stage.title.format(**shown)

    def run(self, log: Log | None = None, cores: int = 1, folder: str | Path = "") -> None:
        """Call the function of the stage."""
        call(self.stage.function, self.files, self.arguments, self.values, log, cores, folder)


def attribute(settings: DatasetSettings, path: str) -> Any:
    """An attribute of settings by its path, such as ``source.files``; themselves for none."""
    return attrgetter(path)(settings) if path else settings


def holds(condition: str, settings: DatasetSettings) -> bool:
    """Whether an attribute of settings is there and not empty; with ``not`` before it the reverse.

    ``automatic``: structure and orders are decided, and not searched phase by phase.
    ``source.all_files``: the recording is read, and not simulated.
    """
    path = condition.removeprefix("not ")
    return bool(attribute(settings, path)) == (path == condition)


def wanted(job: StageJob) -> tuple[str, ...]:
    """The structures that may be chosen; others are searched for their models as starts."""
    structure, searched = automatic(job).structure, searched_forms(job.settings)
    return (structure,) if structure in searched else searched


def polynomials(job: StageJob) -> tuple[str, ...]:
    """The structures of polynomials that are searched, each behind those nested in it."""
    return tuple(filter(is_polynomial, searched_forms(job.settings)))


def _nested(job: StageJob) -> tuple[str, ...]:
    """The structures whose models are starts of a search."""
    nested = NESTED.get(job.values["structure"], ())
    return tuple(structure for structure in nested if structure in searched_forms(job.settings))


def purposes(job: StageJob) -> tuple[str, ...]:
    """The purposes whose models are kept beside that of the configuration; none without inputs."""
    if not (job.settings.automatic and job.settings.channels.inputs):
        return ()
    purpose = automatic(job).purpose
    opposite = "prediction" if purpose in ("auto", "simulation") else "simulation"
    return (opposite,) if purpose == "modes" else (opposite, "modes")


def _part_count(job: StageJob) -> int:
    """How many jobs the candidates of a phase are divided into."""
    grid, per_job = job.settings.order_grid, job.of_run.candidates_per_job
    return order_grid.part_count(job.values["phase"], grid, per_job)


def automatic(job: StageJob) -> AutomaticSettings:
    """The settings of the automatic recipe; of the chapter's the built-in ones."""
    return job.settings.automatic or AutomaticSettings()


def _previous(job: StageJob) -> list[str]:
    previous = order_grid.previous_phase(job.values["phase"], job.settings.order_grid.structure)
    return [previous] if previous else []


def _resonances(job: StageJob) -> list[str]:
    needed = order_grid.needs_resonances(job.values["phase"], job.settings.order_grid)
    return ["spectrum_summary"] if needed else []


LISTS: Mapping[str, Callable[[StageJob], Sequence[str]]] = {
    "structures": lambda job: searched_forms(job.settings),
    "polynomials": polynomials,
    "forms": lambda job: [f for f in searched_forms(job.settings) if not is_polynomial(f)],
    "wanted": wanted,
    "nested": _nested,
    "purposes": purposes,
    "phases": lambda job: order_grid.phases_of_dataset(job.settings),
    "last": lambda job: order_grid.phases_of_dataset(job.settings)[-1:],
    "parts": lambda job: [str(number + 1) for number in range(_part_count(job))],
    "previous": _previous,
    "resonances": _resonances,
}
"""What words in the inputs and outputs of stages stand for."""


def _of_chapter(given: Callable[[DatasetSettings], object]) -> Callable[[StageJob], object]:
    """What the chapter's recipe is given of the settings."""
    return lambda job: None if job.settings.automatic else given(job.settings)


def fit_to_check(job: StageJob) -> object:
    """Constraints and order grid, where constraints in Hz wait for the sampling rate."""
    settings = job.settings
    given = settings.automatic is None and settings.fit.constraints is not None
    waits = given and known_rate(settings) is None
    return (settings.fit, settings.order_grid) if waits else None


def grid(of_phase: Callable[[str, OrderGrid], OrderGrid]) -> Callable[[StageJob], OrderGrid]:
    """What the candidates of a phase, or the selection among them, depend on of the order grid."""
    return lambda job: of_phase(job.values["phase"], job.settings.order_grid)


def choices(*names: str) -> Callable[[StageJob], AutomaticSettings]:
    """Some settings of the automatic recipe, the others built in."""
    return lambda job: AutomaticSettings(**{name: getattr(automatic(job), name) for name in names})


def orders_of_polynomials(job: StageJob) -> AutomaticSettings:
    """The ranges that the search over the orders of polynomials depends on."""
    return AutomaticSettings(orders=replace(automatic(job).orders, nx=None))


def orders_of_states(job: StageJob) -> AutomaticSettings:
    """The range that the search over numbers of states depends on."""
    return AutomaticSettings(orders=OrderRanges(automatic(job).orders.nx))


def _fits(job: StageJob) -> dict[str, object]:
    """What the fits of the automatic recipe have in common."""
    search, given = job.settings.search, automatic(job)
    common = {"weighting": given.weighting, "seed": search.seed}
    return common | {"max_root_radius": given.max_root_radius or search.max_root_radius}


Value = str | Callable[[StageJob], Any]
"""An argument of a stage: the path of an attribute of the settings, or what computes it."""

ARGUMENTS: Mapping[str, Value] = {
    "channels_from_file": "source.channels_from_file",
    "is_validated": lambda job: holds("source.validation_files", job.settings),
    "given": lambda job: job.settings.automatic and job.settings.automatic.preparation,
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
    seconds: float = 0.1  # of processor time, measured on recordings of about a thousand samples
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

    def jobs(self, settings: DatasetSettings, files: DatasetFiles) -> list[StageJob]:
        """Every job of the stage for a data set."""
        jobs = [StageJob(self, settings, files)]
        for wildcard, listed in self.wildcards.items():
            jobs = [
                replace(job, values={**job.values, wildcard: value})
                for job in jobs
                for value in LISTS[listed](job)
            ]
        return jobs


def module_of(function: str) -> Path:
    """The file of the module that holds a function, which is not imported."""
    return Path(__file__).parents[1] / (function.partition(":")[0].replace(".", "/") + ".py")


def paths(entry: str, job: StageJob) -> list[str]:
    """The paths that an entry of a stage's inputs or outputs stands for."""
    name, _, condition = entry.partition(" if ")
    name, _, argument = name.partition(":")
    if name.startswith("{"):
        return [path for e in LISTS[name[1:-1]](job) for path in paths(e, job)]
    if not holds(condition, job.settings):
        return []
    value = getattr(job.files, name)
    if not argument:
        return list(value) if isinstance(value, list) else [value]
    keys = [key for key in _WORD.findall(argument) if key in LISTS]
    return [
        value(*argument.format(**job.values, **dict(zip(keys, values, strict=True))).split(","))
        for values in product(*(LISTS[key](job) for key in keys))
    ]


_TITLES = {
    **{name: name.upper() for name in STRUCTURES},
    "impulse": "impulse-response",
    "ss": "state-space",
    "ss_oe": "output-error state-space",
    "ss_oe_drift": "output-error state-space (with drift)",
    "ss_bj": "Box-Jenkins state-space",
    "delay": "delay",
    "plant": "plant order",
    "nc": "order of C",
    "nd": "order of D",
    "na": "order of A",
    "nb": "order of B",
}
