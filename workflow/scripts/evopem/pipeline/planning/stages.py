"""The stages of an identification: one table for rules, for one process, command and notebook.

A rule of the workflow runs the stage of its name for one data set. Without Snakemake,
:mod:`evopem.pipeline.identification` runs the same ones, in the order that their files ask for.
Nothing here imports numpy, pandas or Snakemake.
"""

from __future__ import annotations

from functools import partial

from evopem.config import order_grid
from evopem.config.settings import DatasetSettings
from evopem.pipeline.planning import stage_lists as of
from evopem.pipeline.planning.stage import Stage
from evopem.pipeline.planning.stage_lists import Task
from evopem.results.layout import IDENTIFICATION, DatasetFiles

PREPARING = ("synthesize", "read_recording", "read_validation", "prepare")
"""Stages that are done for all data sets before any is searched."""

_PREPARED, _VALIDATION = of.PREPARED, of.VALIDATION
_DECIDED = ("decision:preparation", *_PREPARED)
_SCORED = (*_DECIDED, "decision:folds", "decision:delay")

_SHOWN = (
    *("{truth}", "{decisions}", "config", "recording", "recording_info", "{validation_info}"),
    *(*_PREPARED, "spectrum", "spectrum_summary", "{searched}", "candidates", "model"),
    *("frequency_response", "time_response", *_VALIDATION),
)

_decided = partial(Stage, applies=of.is_automatic, demand="estimation")
_searched = partial(Stage, applies=of.is_by_chapter, demand="estimation")

STAGES = (
    Stage(
        "write_settings",
        "configuration:write_configuration",
        "settings",
        outputs=("config",),
        settings={"settings": ""},
        demand="small",
    ),
    Stage(
        "synthesize",
        "acquisition:synthesize_recording",
        "simulating the recording",
        applies=of.is_synthetic,
        outputs=("recording", "recording_info", "truth"),
        settings={"source": "source", "transforms": "preparation.transforms"},
    ),
    Stage(
        "read_recording",
        "acquisition:read_recording",
        "reading the recording",
        applies=of.is_recorded,
        outputs=("recording", "recording_info"),
        given=("channels", "told", "geometry"),
        settings={"recorded": "source.files"},
        recorded=("files",),
    ),
    Stage(
        "read_validation",
        "acquisition:read_validation_recording",
        "reading the validation recording",
        applies=of.is_validated,
        inputs=("{roles}",),
        outputs=("validation_recording", "validation_recording_info"),
        given=("channels", "told"),
        settings={"recorded": "source.validation_files"},
        recorded=("validation_files",),
    ),
    Stage(
        "prepare",
        "preparation:prepare_samples",
        "preparing the samples",
        inputs=("recording", "{validation}"),
        outputs=(*_PREPARED, "{plan}"),
        given=("is_validated", "given", "requirements"),
        settings={
            "settings": "preparation",
            "recorded": "source.all_files",
            "fit": of.fit_to_check,
        },
        demand="estimation",
    ),
    Stage(
        "estimate_spectrum",
        "spectrum:estimate_spectrum",
        "spectrum",
        inputs=_PREPARED,
        outputs=("spectrum", "spectrum_summary"),
        settings={"settings": "spectrum"},
    ),
    Stage(
        "decide_folds",
        "structures:decide_folds",
        "choosing the held-out samples",
        applies=of.is_automatic,
        inputs=_DECIDED,
        outputs=("decision:folds",),
        given=("of_polynomials",),
    ),
    Stage(
        "decide_delay",
        "structures:decide_delay",
        "searching the delay of each input",
        applies=of.is_automatic,
        inputs=_DECIDED,
        outputs=("decision:delay",),
        settings={"ranges": "automatic.orders.nk"},
    ),
    _decided(
        "search_structure",
        "structures:search_structure",
        "searching the orders of {structure} models",
        inputs=("search:{nested}", *_SCORED),
        outputs=("search:{structure}", "{models}"),
        given=("fits", "nested", "with_models"),
        settings={"settings": of.orders_of_structure},
        wildcards={"structure": "structures"},
    ),
    _decided(
        "choose",
        "structures:choose",
        "comparing the structures",
        inputs=("search:{wanted}", *_SCORED),
        outputs=("decision:comparison",),
        given=("fits",),
        settings={"structures": of.wanted, "settings": of.choices("structure", "orders")},
    ),
    _decided(
        "revise",
        "structures:act_on_checks",
        "acting on failed checks",
        inputs=("decision:comparison", *_SCORED),
        outputs=("decision:remedies",),
        given=("fits",),
        settings={"settings": of.choices("purpose", "structure", "orders")},
    ),
    Stage(
        "estimate",
        "chosen:estimate_chosen",
        "searching the chosen model globally",
        applies=of.is_single_automatic,
        inputs=("decision:comparison", "decision:remedies", *_SCORED),
        outputs=("phase:structures", "phase:chosen", "decision:search"),
        given=("search", "fits"),
        settings={"settings": of.choices("purpose", "structure", "orders")},
        demand="estimation",
    ),
    _searched(
        "estimate_candidates",
        "order_search:estimate_candidates",
        "searching the orders: {phase}",
        inputs=(*_PREPARED, "phase:{previous}", "{resonances}"),
        outputs=("part:{phase},{part}",),
        given=("parts", "search", "window"),
        settings={"grid": of.grid(order_grid.grid_of_phase)},
        wildcards={"phase": "phases", "part": "parts"},
        is_part=True,
    ),
    _searched(
        "select_candidate",
        "order_search:select_candidate",
        "selecting the orders: {phase}",
        inputs=("part:{phase},{parts}", *_PREPARED),
        outputs=("phase:{phase}",),
        given=("parts", "search", "window"),
        settings={"grid": of.grid(order_grid.grid_of_selection)},
        wildcards={"phase": "phases"},
    ),
    Stage(
        "complete_model",
        "chosen:complete_model",
        "model and its uncertainty",
        inputs=("{decided}", "phase:{last}", *_PREPARED),
        outputs=("model", "model_mat", "frequency_response", "time_response", "{about_search}"),
        given=("search", "window", "phases", "fit", "fits"),
        settings={"settings": of.choices("orders", "evaluations")},
        demand="model",
    ),
    _decided(
        "complete_other",
        "validation:complete_other",
        "model for the other purpose",
        inputs=("decision:comparison", *_SCORED),
        outputs=("other_model:{purpose}", "other_errors:{purpose}"),
        given=("search", "fits"),
        settings={"settings": of.choices("orders"), "constraints": "fit.constraints"},
        wildcards={"purpose": "purposes"},
    ),
    Stage(
        "tabulate",
        "decisions:tabulate_candidates",
        "table of candidates",
        inputs=("phase:{phases}", "{tabulated}"),
        outputs=("candidates",),
        given=("phases", "structures"),
        demand="small",
    ),
    Stage(
        "validate",
        "validation:validate_model",
        "validation",
        inputs=("model", *_PREPARED, "{compared}"),
        outputs=(*_VALIDATION, "modes"),
        given=("spectrum",),
        settings={"phase": of.compared_phase},
    ),
    Stage(
        "collect_decisions",
        "decisions:collect_decisions",
        "decisions",
        applies=of.is_automatic,
        inputs=(
            *("search:{structures}", "recording_info", *_SCORED, "decision:comparison"),
            *("decision:remedies", "decision:search", "other_errors:{purposes}"),
        ),
        outputs=("decisions",),
        given=("structures",),
        settings={"others": of.purposes},
        demand="small",
    ),
    Stage(
        "summarize",
        "decisions:summarize_dataset",
        "checks",
        inputs=("recording_info", "{searched}", "model", "validation"),
        outputs=("summary",),
        given=("phases", "is_automatic"),
        demand="small",
    ),
    Stage(
        "draw_figures",
        "report:draw_figures",
        "figures",
        inputs=_SHOWN,
        outputs=("figures",),
        is_page=True,
    ),
    Stage(
        "write_report",
        "report:write_report",
        "report",
        inputs=(*_SHOWN, "figures"),
        outputs=("report",),
        is_page=True,
    ),
)
"""Every stage, and :data:`WHOLE`, which runs all of them in one job."""

WHOLE = Stage(
    IDENTIFICATION,
    "identification:identify_dataset",
    "identification",
    settings={"settings": "", "with_report": lambda t: t.run.report == "html"},
    recorded=("files", "validation_files"),
    demand="estimation",
)


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
