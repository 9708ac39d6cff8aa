"""The stages of an identification: one table for rules, for one process, command and notebook.

A rule of the workflow runs the stage of its name for one data set. Without Snakemake,
:mod:`evopem.pipeline.identification` runs the same ones, in the order that their files ask for.
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
from evopem.config.settings import (
    AutomaticSettings,
    DatasetSettings,
    OrderRanges,
)
from evopem.config.structures import (
    AUTOMATIC_STRUCTURES,
    is_polynomial,
    searched_structures,
    searched_variants,
)
from evopem.pipeline.constraint_plan import known_rate
from evopem.results.layout import DatasetFiles

Demand = Literal["small", "reading", "model", "estimation"]

PREPARING = (*("synthesize", "read_recording", "read_validation", "prepare"),)
"""Stages that are done for all data sets before any is searched."""

_WORD = re.compile(r"{(\w+)}")


@dataclass(frozen=True)
class Task:
    """One job: a stage of a data set, with values of the stage's own wildcards.

    Attributes
    ----------
    settings : DatasetSettings
    files : DatasetFiles
    values : dict of str to str
        Values of wildcards by their names, such as ``{"structure": "oe"}``.
    candidates_per_job : int or "auto"
        How the candidates of a phase are divided into parts.
    """

    settings: DatasetSettings
    files: DatasetFiles
    values: Mapping[str, str] = field(default_factory=dict)
    candidates_per_job: int | Literal["auto"] = "auto"


Value = str | Callable[[Task], Any]
"""An argument of a stage: the path of an attribute of the settings, or what computes it."""


@dataclass(frozen=True)
class Stage:
    """What one job does: the function it calls, and the files that the function reads and writes.

    Attributes
    ----------
    name : str
        That of its rule.
    function : str
        Module below ``evopem.pipeline`` and name, with a colon between them.
    title : str
        What the stage does, in words; it may hold wildcards.
    applies : callable
        Whether a data set has the stage.
    inputs, outputs : tuple of str
        Attributes of :class:`.DatasetFiles`, with the argument of a method behind a colon. Words in
        braces are wildcards or keys of :data:`LISTS`, which stand for several files or none.
    settings : dict of str to Value
        Arguments of the function by their names: exactly the settings that the results depend on.
    wildcards : dict of str to str
        For each wildcard of the outputs, the list of :data:`LISTS` that holds its values.
    recorded : tuple of str
        Attributes of the source that hold recorded files which the stage reads.
    demand : {"small", "reading", "model", "estimation"}
        How memory and time grow with the recording.
    is_page : bool
        Whether it belongs to the report.
    is_part : bool
        Whether its outputs are parts of those of another stage.
    """

    name: str
    function: str
    title: str
    applies: Callable[[DatasetSettings], bool]
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    settings: Mapping[str, Value] = field(default_factory=dict)
    wildcards: Mapping[str, str] = field(default_factory=dict)
    recorded: tuple[str, ...] = ()
    demand: Demand = "reading"
    is_page: bool = False
    is_part: bool = False

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
        return {name: _value(value, task) for name, value in self.settings.items()}

    def words(self, task: Task) -> str:
        """What a job does, in words."""
        shown = {name: _TITLES.get(value, value) for name, value in task.values.items()}
        return self.title.format(**shown)


def module_of(function: str) -> Path:
    """The file of the module that holds a function, which is not imported."""
    return Path(__file__).parent / (function.partition(":")[0].replace(".", "/") + ".py")


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


def _value(value: Value, task: Task) -> Any:
    if not isinstance(value, str):
        return value(task)
    provided: Any = task.settings
    for name in filter(None, value.split(".")):
        provided = getattr(provided, name)
    return provided


def _is_recorded(settings: DatasetSettings) -> bool:
    return bool(settings.source.all_files)


def _is_synthetic(settings: DatasetSettings) -> bool:
    return not settings.source.all_files


def is_validated(settings: DatasetSettings) -> bool:
    """Whether there is an independent recording for validation."""
    return bool(settings.source.validation_files)


def _has_one(settings: DatasetSettings) -> bool:
    return settings.is_single_channel


def _has_several(settings: DatasetSettings) -> bool:
    return not settings.is_single_channel


def _is_automatic(settings: DatasetSettings) -> bool:
    return settings.is_single_channel and settings.automatic is not None


def _is_by_chapter(settings: DatasetSettings) -> bool:
    return settings.automatic is None


def _automatic(task: Task) -> AutomaticSettings:
    return task.settings.automatic or AutomaticSettings()


def _structures(task: Task) -> tuple[str, ...]:
    if not task.settings.is_single_channel:
        return tuple(structure for structure, _ in searched_variants(task.settings))
    return searched_structures(_automatic(task).structure)


def _wanted(task: Task) -> tuple[str, ...]:
    structure = _automatic(task).structure
    return (structure,) if structure else _structures(task)


def _nested(task: Task) -> tuple[str, ...]:
    return AUTOMATIC_STRUCTURES[task.values["structure"]]


def _purposes(task: Task) -> tuple[str, ...]:
    """The purpose whose model is kept beside that of the configuration; none without inputs."""
    own = _automatic(task)
    if task.settings.is_single_channel:
        return (own.other_purpose,)
    if not task.settings.channels.inputs:
        return ()
    return ("simulation" if own.purpose == "prediction" else "prediction",)


def _phases(task: Task) -> tuple[str, ...]:
    return order_grid.phases_of_dataset(task.settings)


def _parts(task: Task) -> list[str]:
    return [str(number) for number in range(1, _part_count(task) + 1)]


def _part_count(task: Task) -> int:
    grid = task.settings.order_grid
    return order_grid.part_count(task.values["phase"], grid, task.candidates_per_job)


def _previous(task: Task) -> list[str]:
    structure = task.settings.order_grid.structure
    previous = order_grid.previous_phase(task.values["phase"], structure)
    return [previous] if previous else []


def _resonances(task: Task) -> list[str]:
    counted = order_grid.needs_resonances(task.values["phase"], task.settings.order_grid)
    return ["spectrum_summary"] if counted else []


def _roles(task: Task) -> list[str]:
    return ["recording_info"] if _is_told(task) else []


def _is_told(task: Task) -> bool:
    """Whether input, output and time are told from the first file."""
    return getattr(task.settings.source, "channels_from_file", False)


LISTS: Mapping[str, Callable[[Task], Sequence[str]]] = {
    "structures": _structures,
    "wanted": _wanted,
    "nested": _nested,
    "purposes": _purposes,
    "phases": _phases,
    "last": lambda task: _phases(task)[-1:],
    "compared": lambda task: [order_grid.phase_of_orders_of(task.settings)],
    "parts": _parts,
    "previous": _previous,
    "resonances": _resonances,
    "roles": _roles,
    "validation": lambda task: ["validation_recording"] if is_validated(task.settings) else [],
    "validation_info": lambda task: (
        ["validation_recording_info"] if is_validated(task.settings) else []
    ),
    "plan": lambda task: [] if _is_by_chapter(task.settings) else ["decision:preparation"],
    "truth": lambda task: ["truth"] if _is_synthetic(task.settings) else [],
    "decided": lambda task: (
        ["decision:preparation", "decision:remedies"] if _is_automatic(task.settings) else []
    ),
    "decisions": lambda task: ["decisions"] if _is_automatic(task.settings) else [],
}
"""What words in the inputs and outputs of stages stand for."""


def _window(task: Task) -> object:
    settings = task.settings
    return None if settings.automatic else order_grid.scoring_window(settings)


def _fit_to_check(task: Task) -> object:
    """Constraints and order grid, where constraints in Hz wait for the sampling rate."""
    settings = task.settings
    given = _is_by_chapter(settings) and settings.fit.constraints is not None
    waits = given and known_rate(settings) is None
    return (settings.fit, settings.order_grid) if waits else None


def _ranges_of_form(task: Task) -> OrderRanges:
    """The ranges that the search over the orders of a structure or form depends on."""
    orders = _automatic(task).orders
    of_polynomials = is_polynomial(task.values["structure"])
    return orders.of_polynomials if of_polynomials else orders.of_states


def _choices(*names: str) -> Callable[[Task], AutomaticSettings]:
    """Some settings of the automatic recipe, the others built in."""

    def provide(task: Task) -> AutomaticSettings:
        own = _automatic(task)
        return AutomaticSettings(**{name: getattr(own, name) for name in names})

    return provide


_PREPARED = ("prepared", "transforms")
_DECIDED = ("decision:preparation", *_PREPARED)
_VALIDATION = (*("validation", "residual_autocorrelation", "cross_correlation", "simulation"),)
_SHOWN: tuple[str, ...] = (
    *("{truth}", "{decisions}", "config", "recording", "recording_info", *_PREPARED, "spectrum"),
    *("spectrum_summary", "phase:{phases}", "candidates", "model", "frequency_response"),
    *("time_response", *_VALIDATION, "horizons"),
)

_SHOWN_CHANNELS: tuple[str, ...] = (
    *("search:{structures}", "config", "recording_info", "{validation_info}", *_PREPARED),
    *("decision:comparison", "decision:remedies", "decisions", "model", "modes_json"),
    *("frequency_response", *_VALIDATION),
)

STAGES = (
    Stage(
        "write_settings",
        "configuration:write_configuration",
        "settings",
        lambda _: True,
        outputs=("config",),
        settings={"settings": ""},
        demand="small",
    ),
    Stage(
        "synthesize",
        "synthesis:synthesize_recording",
        "simulating the recording",
        _is_synthetic,
        outputs=("recording", "recording_info", "truth"),
        settings={"source": "source", "transforms": "preparation.transforms"},
    ),
    Stage(
        "read_recording",
        "acquisition:read_recording",
        "reading the recording",
        _is_recorded,
        outputs=("recording", "recording_info"),
        settings={
            "recorded": "source.files",
            "channels": "channels",
            "told": _is_told,
            "geometry": "geometry",
        },
        recorded=("files",),
    ),
    Stage(
        "read_validation",
        "acquisition:read_validation_recording",
        "reading the validation recording",
        is_validated,
        inputs=("{roles}",),
        outputs=("validation_recording", "validation_recording_info"),
        settings={
            "recorded": "source.validation_files",
            "channels": "channels",
            "told": _is_told,
        },
        recorded=("validation_files",),
    ),
    Stage(
        "prepare",
        "preparation:prepare_samples",
        "preparing the samples",
        lambda _: True,
        inputs=("recording", "{validation}"),
        outputs=(*_PREPARED, "{plan}"),
        settings={
            "settings": "preparation",
            "is_validated": lambda t: is_validated(t.settings),
            "recorded": "source.all_files",
            "given": lambda t: order_grid.given_preparation(t.settings),
            "requirements": lambda t: (
                order_grid.sample_requirements(t.settings) if _is_by_chapter(t.settings) else None
            ),
            "fit": _fit_to_check,
        },
        demand="estimation",
    ),
    Stage(
        "estimate_spectrum",
        "spectrum:estimate_spectrum",
        "spectrum",
        _has_one,
        inputs=_PREPARED,
        outputs=("spectrum", "spectrum_summary"),
        settings={"settings": "spectrum"},
    ),
    Stage(
        "decide_folds",
        "automatic_search:decide_folds",
        "choosing the held-out samples",
        _is_automatic,
        inputs=_DECIDED,
        outputs=("decision:folds",),
    ),
    Stage(
        "decide_folds",
        "multichannel.search:decide_channel_folds",
        "choosing the held-out samples",
        _has_several,
        inputs=_PREPARED,
        outputs=("decision:folds",),
    ),
    Stage(
        "decide_delay",
        "automatic_search:decide_delay",
        "searching the delay",
        _is_automatic,
        inputs=_DECIDED,
        outputs=("decision:delay",),
        settings={"limits": "automatic.orders.nk.all"},
    ),
    Stage(
        "decide_delay",
        "multichannel.search:decide_input_delays",
        "searching the delays of the inputs",
        _has_several,
        inputs=_PREPARED,
        outputs=("decision:delay",),
        settings={"ranges": "automatic.orders.nk"},
    ),
    Stage(
        "search_structure",
        "automatic_search:search_structure",
        "searching the orders of {structure} models",
        _is_automatic,
        inputs=("search:{nested}", *_DECIDED, "decision:folds", "decision:delay"),
        outputs=("search:{structure}",),
        settings={"settings": _choices("orders")},
        wildcards={"structure": "structures"},
        demand="estimation",
    ),
    Stage(
        "search_structure",
        "multichannel.search:search_channel_structure",
        "searching the orders of {structure} models",
        _has_several,
        inputs=(*_PREPARED, "decision:folds", "decision:delay"),
        outputs=("search:{structure}", "models_of_orders:{structure}"),
        settings={
            "ranges": _ranges_of_form,
            "search_settings": "state_space_search",
            "weighting": "automatic.weighting",
        },
        wildcards={"structure": "structures"},
        demand="estimation",
    ),
    Stage(
        "choose",
        "automatic_search:compare_structures",
        "comparing the structures",
        _is_automatic,
        inputs=("search:{wanted}", *_DECIDED, "decision:folds", "decision:delay"),
        outputs=("decision:comparison", "phase:structures"),
        settings={
            "structures": _wanted,
            "settings": _choices("purpose", "structure", "orders"),
        },
        demand="estimation",
    ),
    Stage(
        "choose",
        "multichannel.search:choose_channel_structure",
        "comparing the structures",
        _has_several,
        inputs=("search:{structures}", *_PREPARED, "decision:folds", "decision:delay"),
        outputs=("decision:comparison",),
        settings={
            "structures": _structures,
            "ranges": "automatic.orders",
            "search_settings": "state_space_search",
            "weighting": "automatic.weighting",
        },
        demand="estimation",
    ),
    Stage(
        "revise",
        "multichannel.search:act_on_channel_checks",
        "acting on failed checks",
        _has_several,
        inputs=("decision:comparison", *_PREPARED, "decision:folds", "decision:delay"),
        outputs=("decision:remedies",),
        settings={
            "purpose": "automatic.purpose",
            "ranges": "automatic.orders",
            "search_settings": "state_space_search",
            "weighting": "automatic.weighting",
        },
        demand="estimation",
    ),
    Stage(
        "revise",
        "automatic_search:act_on_checks",
        "acting on failed checks",
        _is_automatic,
        inputs=("decision:comparison", *_DECIDED, "decision:folds", "decision:delay"),
        outputs=("decision:remedies",),
        settings={"settings": _choices("purpose", "structure", "orders")},
        demand="estimation",
    ),
    Stage(
        "estimate",
        "automatic_model:estimate_chosen",
        "searching the chosen model globally",
        _is_automatic,
        inputs=("decision:remedies", *_DECIDED),
        outputs=("phase:chosen",),
        settings={"search": "search"},
        demand="estimation",
    ),
    Stage(
        "estimate_candidates",
        "order_search:estimate_candidates",
        "searching the orders: {phase}",
        _is_by_chapter,
        inputs=(*_PREPARED, "phase:{previous}", "{resonances}"),
        outputs=("part:{phase},{part}",),
        settings={
            "parts": _part_count,
            "grid": lambda t: order_grid.grid_of_phase(t.values["phase"], t.settings.order_grid),
            "search": "search",
            "window": _window,
        },
        wildcards={"phase": "phases", "part": "parts"},
        demand="estimation",
        is_part=True,
    ),
    Stage(
        "select_candidate",
        "order_search:select_candidate",
        "selecting the orders: {phase}",
        _is_by_chapter,
        inputs=("part:{phase},{parts}", *_PREPARED),
        outputs=("phase:{phase}",),
        settings={
            "parts": _part_count,
            "grid": lambda t: order_grid.grid_of_selection(
                t.values["phase"], t.settings.order_grid
            ),
            "search": "search",
            "window": _window,
        },
        wildcards={"phase": "phases"},
        demand="estimation",
    ),
    Stage(
        "complete_model",
        "model:complete_model",
        "model and its uncertainty",
        _has_one,
        inputs=("{decided}", "phase:{last}", *_PREPARED),
        outputs=("model", "model_mat", "modes", "frequency_response", "time_response"),
        settings={"search": "search", "window": _window, "phases": _phases, "fit": "fit"},
        demand="model",
    ),
    Stage(
        "complete_model",
        "multichannel.chosen:estimate_chosen_state_space",
        "searching the chosen model globally",
        _has_several,
        inputs=(*_PREPARED, "decision:remedies"),
        outputs=("model", "model_mat", "frequency_response"),
        settings={
            "ranges": "automatic.orders",
            "search": "state_space_search",
            "weighting": "automatic.weighting",
            "constraints": "fit.constraints",
        },
        demand="estimation",
    ),
    Stage(
        "complete_other",
        "automatic_model:complete_other_model",
        "model for the other purpose",
        _is_automatic,
        inputs=("decision:comparison", *_DECIDED),
        outputs=("other_model:{purpose}", "other_errors:{purpose}"),
        settings={"search": "search"},
        wildcards={"purpose": "purposes"},
        demand="estimation",
    ),
    Stage(
        "complete_other",
        "multichannel.chosen:complete_other_state_space",
        "model for the other purpose",
        _has_several,
        inputs=(*_PREPARED, "decision:comparison"),
        outputs=("other_model:{purpose}", "other_errors:{purpose}"),
        settings={
            "ranges": "automatic.orders",
            "search": "state_space_search",
            "weighting": "automatic.weighting",
            "constraints": "fit.constraints",
        },
        wildcards={"purpose": "purposes"},
        demand="estimation",
    ),
    Stage(
        "tabulate",
        "candidates:tabulate_candidates",
        "table of candidates",
        _has_one,
        inputs=("phase:{phases}",),
        outputs=("candidates",),
        settings={"phases": _phases},
        demand="small",
    ),
    Stage(
        "tabulate",
        "multichannel.candidates:tabulate_channel_candidates",
        "table of candidates",
        _has_several,
        inputs=("search:{structures}", "decision:comparison", "decision:remedies"),
        outputs=("candidates",),
        settings={"structures": _structures},
        demand="small",
    ),
    Stage(
        "validate",
        "validation:validate_model",
        "validation",
        _has_one,
        inputs=("model", *_PREPARED, "phase:{compared}", "spectrum_summary"),
        outputs=(*_VALIDATION, "horizons"),
        settings={"phase": lambda t: order_grid.phase_of_orders_of(t.settings)},
    ),
    Stage(
        "validate",
        "multichannel.validation:validate_state_space",
        "validation",
        _has_several,
        inputs=("models_of_orders:{structures}", "decision:remedies", *_PREPARED, "model"),
        outputs=(*_VALIDATION, "modes", "modes_json"),
    ),
    Stage(
        "collect_decisions",
        "automatic_model:collect_decisions",
        "decisions",
        _is_automatic,
        inputs=(
            *("search:{structures}", "recording_info", *_DECIDED, "decision:folds"),
            *("decision:delay", "decision:comparison", "decision:remedies"),
            "other_errors:{purposes}",
        ),
        outputs=("decisions",),
        settings={"structures": _structures, "other": lambda t: _purposes(t)[0]},
        demand="small",
    ),
    Stage(
        "collect_decisions",
        "multichannel.decisions:collect_state_space_decisions",
        "decisions",
        _has_several,
        inputs=(
            *("decision:preparation", "decision:folds", "decision:delay", "search:{structures}"),
            *("decision:comparison", "decision:remedies", "other_errors:{purposes}"),
        ),
        outputs=("decisions",),
        settings={"structures": _structures, "others": _purposes},
        demand="small",
    ),
    Stage(
        "summarize",
        "summary:summarize_dataset",
        "checks",
        _has_one,
        inputs=("recording_info", "spectrum_summary", "phase:{phases}", "model", "validation"),
        outputs=("summary",),
        settings={"phases": _phases},
        demand="small",
    ),
    Stage(
        "summarize",
        "multichannel.summary:summarize_state_space",
        "checks",
        _has_several,
        inputs=(
            *("search:{structures}", "decision:remedies", "recording_info", "model"),
            *("modes_json", "validation"),
        ),
        outputs=("summary",),
        demand="small",
    ),
    Stage(
        "draw_figures",
        "figures:draw_figures",
        "figures",
        _has_one,
        inputs=_SHOWN,
        outputs=("figures",),
        is_page=True,
    ),
    Stage(
        "write_report",
        "report:write_report",
        "report",
        _has_one,
        inputs=(*_SHOWN, "{validation_info}", "figures"),
        outputs=("report",),
        is_page=True,
    ),
    Stage(
        "draw_figures",
        "figures:draw_channel_figures",
        "figures",
        _has_several,
        inputs=_SHOWN_CHANNELS,
        outputs=("figures",),
        settings={"settings": "", "structures": _structures},
        is_page=True,
    ),
    Stage(
        "write_report",
        "report:write_channel_report",
        "report",
        _has_several,
        inputs=(*_SHOWN_CHANNELS, "figures"),
        outputs=("report",),
        settings={"settings": "", "structures": _structures},
        is_page=True,
    ),
)
"""Every stage. Those of one name make the same files of different kinds of data sets."""

_TITLES = {
    **{name: name.upper() for name in AUTOMATIC_STRUCTURES},
    "delay": "delay",
    "joint": "joint order",
    "nc": "order of C",
    "nd": "order of D",
    "na": "order of A",
    "nb": "order of B",
}


def stages_of(settings: DatasetSettings, with_report: bool = True) -> list[Stage]:
    """The stages of a data set, in the order of the table."""
    return [
        stage for stage in STAGES if stage.applies(settings) and (with_report or not stage.is_page)
    ]


def results_of(settings: DatasetSettings, files: DatasetFiles, with_report: bool) -> list[str]:
    """Every result of a data set, those that only other stages read among them."""
    whole = Task(settings, files)
    return [
        path
        for stage in stages_of(settings, with_report)
        if not stage.is_part
        for task in stage.tasks(whole)
        for path in stage.made_by(task)
    ]
