"""What a job asks of its data set: lists of files, and arguments.

Nothing here imports numpy, pandas or Snakemake.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from evopem.config import order_grid
from evopem.config.configuration import RunSettings
from evopem.config.settings import AutomaticSettings, DatasetSettings, InputRanges, OrderGrid
from evopem.config.structures import (
    AUTOMATIC_STRUCTURES,
    is_polynomial,
    searched_forms,
)
from evopem.pipeline.planning.constraint_plan import known_rate
from evopem.results.layout import DatasetFiles


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


def structures(task: Task) -> tuple[str, ...]:
    """The structures that are searched."""
    return searched_forms(task.settings)


def wanted(task: Task) -> tuple[str, ...]:
    """The structures that may be chosen; others are searched for their models as starts."""
    structure = _automatic(task).structure
    return (structure,) if structure in structures(task) else structures(task)


def _nested(task: Task) -> tuple[str, ...]:
    """The structures whose models are starts of a search."""
    single = task.settings.is_single_channel
    return AUTOMATIC_STRUCTURES[task.values["structure"]] if single else ()


def purposes(task: Task) -> tuple[str, ...]:
    """The purpose whose model is kept beside that of the configuration; none without inputs."""
    kept = task.settings.automatic and task.settings.channels.inputs
    return (_automatic(task).other_purpose,) if kept else ()


def _phases(task: Task) -> tuple[str, ...]:
    """The phases of an order search."""
    return order_grid.phases_of_dataset(task.settings)


def _part_count(task: Task) -> int:
    """How many jobs the candidates of a phase are divided into."""
    grid, per_job = task.settings.order_grid, task.run.candidates_per_job
    return order_grid.part_count(task.values["phase"], grid, per_job)


def _is_told(task: Task) -> bool:
    """Whether input, output and time are told from the first file."""
    return getattr(task.settings.source, "channels_from_file", False)


def _automatic(task: Task) -> AutomaticSettings:
    return task.settings.automatic or AutomaticSettings()


def compared_phase(task: Task) -> str | None:
    """The phase over whose models the modes are compared; None for the automatic recipe."""
    return order_grid.phase_of_orders_of(task.settings)


def _previous(task: Task) -> list[str]:
    structure = task.settings.order_grid.structure
    previous = order_grid.previous_phase(task.values["phase"], structure)
    return [previous] if previous else []


def _resonances(task: Task) -> list[str]:
    needed = order_grid.needs_resonances(task.values["phase"], task.settings.order_grid)
    return ["spectrum_summary"] if needed else []


def _where(condition: str, *names: str) -> Callable[[Task], list[str]]:
    """Some files where a condition of the settings holds."""
    return lambda task: list(names) if holds(condition, task.settings) else []


DECIDED = ("preparation", "folds", "delay")
"""Decisions before any search."""

LISTS: Mapping[str, Callable[[Task], Sequence[str]]] = {
    "structures": structures,
    "wanted": wanted,
    "nested": _nested,
    "purposes": purposes,
    "phases": _phases,
    "last": lambda task: _phases(task)[-1:],
    "parts": lambda task: [str(number + 1) for number in range(_part_count(task))],
    "previous": _previous,
    "resonances": _resonances,
    "validation": _where("source.validation_files", "validation_recording"),
    "validation_info": _where("source.validation_files", "validation_recording_info"),
    "truth": _where("not source.all_files", "truth"),
    "decided": _where("automatic", *(f"decision:{each}" for each in DECIDED)),
    "chosen": _where("automatic", "decision:comparison", "decision:remedies"),
    "selected": _where("not automatic", "phase:{last}"),
    "found": _where("automatic", "decision:search"),
    "searched": _where("automatic", "search:{structures}", "decision:search"),
    "decisions": _where("automatic", "decisions"),
    "models": _where("automatic", "models_of_orders:{structure}"),
    "models_of_orders": _where("automatic", "models_of_orders:{structures}"),
}
"""What words in the inputs and outputs of stages stand for."""

PREPARED = ("prepared", "transforms")
VALIDATION = (
    *("validation", "residual_autocorrelation", "cross_correlation", "simulation", "horizons"),
)


def _window(task: Task) -> object:
    """The samples on which the chapter's recipe compares models."""
    settings = task.settings
    return None if settings.automatic else order_grid.scoring_window(settings)


def _requirements(task: Task) -> object:
    """What a record must have for the order grid of the chapter's recipe."""
    settings = task.settings
    return None if settings.automatic else order_grid.sample_requirements(settings)


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
        **{name: getattr(_automatic(task), name) for name in names}
    )


def orders_of_structure(task: Task) -> AutomaticSettings:
    """The ranges that the search over the orders of a structure depends on."""
    orders = _automatic(task).orders
    polynomial = is_polynomial(task.values["structure"])
    return AutomaticSettings(orders=orders.of_polynomials if polynomial else orders.of_states)


def delays(task: Task) -> InputRanges:
    """The ranges that the delays of inputs are searched in."""
    return _automatic(task).orders.nk


def _fits(task: Task) -> dict[str, object]:
    """What fits of several channels have in common; those of one channel depend on nothing."""
    common: dict[str, object] = {"objective": "quadratic", "level": True}
    search, own = task.settings.search, _automatic(task)
    if task.settings.is_single_channel:
        return common | {"weighting": None, "max_root_radius": 0.9999, "seed": 1}
    radius, seed = search.max_root_radius, search.seed
    return common | {"weighting": own.weighting, "max_root_radius": radius, "seed": seed}


Value = str | Callable[[Task], Any]
"""An argument of a stage: the path of an attribute of the settings, or what computes it."""

ARGUMENTS: Mapping[str, Value] = {
    "told": _is_told,
    "is_validated": lambda task: holds("source.validation_files", task.settings),
    "given": lambda task: order_grid.given_preparation(task.settings),
    "requirements": _requirements,
    "of_polynomials": "is_single_channel",
    "nested": _nested,
    "structures": structures,
    "phases": _phases,
    "parts": _part_count,
    "window": _window,
    "fits": _fits,
}
"""Arguments that are the same in every stage; others of their names are attributes of settings."""
