"""The stages of an identification: one table for rules, for one process, command and notebook.

A rule of the workflow runs the stage of its name for one data set. Without Snakemake,
:mod:`evopem.pipeline.identification` runs the same ones, in the order that their files ask for.
Nothing here imports numpy, pandas or Snakemake.
"""

from __future__ import annotations

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

STAGES = (
    Stage(
        "write_settings",
        "configuration:write_configuration",
        "settings",
        of.is_any,
        outputs=("config",),
        settings={"settings": ""},
        demand="small",
    ),
    Stage(
        "synthesize",
        "acquisition:synthesize_recording",
        "simulating the recording",
        of.is_synthetic,
        outputs=("recording", "recording_info", "truth"),
        settings={"source": "source", "transforms": "preparation.transforms"},
    ),
    Stage(
        "read_recording",
        "acquisition:read_recording",
        "reading the recording",
        of.is_recorded,
        outputs=("recording", "recording_info"),
        settings={
            "recorded": "source.files",
            "channels": "channels",
            "told": of.is_told,
            "geometry": "geometry",
        },
        recorded=("files",),
    ),
    Stage(
        "read_validation",
        "acquisition:read_validation_recording",
        "reading the validation recording",
        of.is_validated,
        inputs=("{roles}",),
        outputs=("validation_recording", "validation_recording_info"),
        settings={
            "recorded": "source.validation_files",
            "channels": "channels",
            "told": of.is_told,
        },
        recorded=("validation_files",),
    ),
    Stage(
        "prepare",
        "preparation:prepare_samples",
        "preparing the samples",
        of.is_any,
        inputs=("recording", "{validation}"),
        outputs=(*_PREPARED, "{plan}"),
        settings={
            "settings": "preparation",
            "is_validated": lambda t: of.is_validated(t.settings),
            "recorded": "source.all_files",
            "given": lambda t: order_grid.given_preparation(t.settings),
            "requirements": of.requirements,
            "fit": of.fit_to_check,
        },
        demand="estimation",
    ),
    Stage(
        "estimate_spectrum",
        "spectrum:estimate_spectrum",
        "spectrum",
        of.is_single,
        inputs=_PREPARED,
        outputs=("spectrum", "spectrum_summary"),
        settings={"settings": "spectrum"},
    ),
    Stage(
        "decide_folds",
        "structures:decide_folds",
        "choosing the held-out samples",
        of.is_automatic,
        inputs=_DECIDED,
        outputs=("decision:folds",),
        settings={"of_polynomials": lambda t: of.is_single(t.settings)},
    ),
    Stage(
        "decide_delay",
        "structures:decide_delay",
        "searching the delay of each input",
        of.is_automatic,
        inputs=_DECIDED,
        outputs=("decision:delay",),
        settings={"ranges": "automatic.orders.nk"},
    ),
    Stage(
        "search_structure",
        "structures:search_structure",
        "searching the orders of {structure} models",
        of.is_automatic,
        inputs=("search:{nested}", *_SCORED),
        outputs=("search:{structure}", "{models}"),
        settings={
            "settings": of.orders_of_structure,
            "fits": of.fits,
            "nested": of.nested,
            "with_models": lambda t: of.has_several(t.settings),
        },
        wildcards={"structure": "structures"},
        demand="estimation",
    ),
    Stage(
        "choose",
        "structures:choose",
        "comparing the structures",
        of.is_automatic,
        inputs=("search:{wanted}", *_SCORED),
        outputs=("decision:comparison",),
        settings={
            "structures": of.wanted,
            "settings": of.choices("structure", "orders"),
            "fits": of.fits,
        },
        demand="estimation",
    ),
    Stage(
        "revise",
        "structures:act_on_checks",
        "acting on failed checks",
        of.is_automatic,
        inputs=("decision:comparison", *_SCORED),
        outputs=("decision:remedies",),
        settings={"settings": of.choices("purpose", "structure", "orders"), "fits": of.fits},
        demand="estimation",
    ),
    Stage(
        "estimate",
        "chosen:estimate_chosen",
        "searching the chosen model globally",
        of.is_single_automatic,
        inputs=("decision:comparison", "decision:remedies", *_SCORED),
        outputs=("phase:structures", "phase:chosen", "decision:search"),
        settings={
            "search": "search",
            "settings": of.choices("purpose", "structure", "orders"),
            "fits": of.fits,
        },
        demand="estimation",
    ),
    Stage(
        "estimate_candidates",
        "order_search:estimate_candidates",
        "searching the orders: {phase}",
        of.is_by_chapter,
        inputs=(*_PREPARED, "phase:{previous}", "{resonances}"),
        outputs=("part:{phase},{part}",),
        settings={
            "parts": of.part_count,
            "grid": lambda t: order_grid.grid_of_phase(t.values["phase"], t.settings.order_grid),
            "search": "search",
            "window": of.window,
        },
        wildcards={"phase": "phases", "part": "parts"},
        demand="estimation",
        is_part=True,
    ),
    Stage(
        "select_candidate",
        "order_search:select_candidate",
        "selecting the orders: {phase}",
        of.is_by_chapter,
        inputs=("part:{phase},{parts}", *_PREPARED),
        outputs=("phase:{phase}",),
        settings={
            "parts": of.part_count,
            "grid": lambda t: order_grid.grid_of_selection(
                t.values["phase"], t.settings.order_grid
            ),
            "search": "search",
            "window": of.window,
        },
        wildcards={"phase": "phases"},
        demand="estimation",
    ),
    Stage(
        "complete_model",
        "chosen:complete_model",
        "model and its uncertainty",
        of.is_any,
        inputs=("{decided}", "phase:{last}", *_PREPARED),
        outputs=("model", "model_mat", "frequency_response", "{time_response}", "{about_search}"),
        settings={
            "search": "search",
            "window": of.window,
            "phases": of.phases,
            "fit": "fit",
            "settings": of.choices("orders", "evaluations"),
            "fits": of.fits,
        },
        demand="model",
    ),
    Stage(
        "complete_other",
        "validation:complete_other",
        "model for the other purpose",
        of.is_automatic,
        inputs=("decision:comparison", *_SCORED),
        outputs=("other_model:{purpose}", "other_errors:{purpose}"),
        settings={
            "search": "search",
            "settings": of.choices("orders"),
            "fits": of.fits,
            "constraints": "fit.constraints",
        },
        wildcards={"purpose": "purposes"},
        demand="estimation",
    ),
    Stage(
        "tabulate",
        "decisions:tabulate_candidates",
        "table of candidates",
        of.is_any,
        inputs=("phase:{phases}", "{tabulated}"),
        outputs=("candidates",),
        settings={"phases": of.phases, "structures": of.structures},
        demand="small",
    ),
    Stage(
        "validate",
        "validation:validate_model",
        "validation",
        of.is_any,
        inputs=("model", *_PREPARED, "{compared}"),
        outputs=(*_VALIDATION, "modes"),
        settings={"phase": of.compared_phase, "spectrum": "spectrum"},
    ),
    Stage(
        "collect_decisions",
        "decisions:collect_decisions",
        "decisions",
        of.is_automatic,
        inputs=(
            *("search:{structures}", "recording_info", *_SCORED, "decision:comparison"),
            *("decision:remedies", "decision:search", "other_errors:{purposes}"),
        ),
        outputs=("decisions",),
        settings={"structures": of.structures, "others": of.purposes},
        demand="small",
    ),
    Stage(
        "summarize",
        "decisions:summarize_dataset",
        "checks",
        of.is_any,
        inputs=("recording_info", "{searched}", "model", "validation"),
        outputs=("summary",),
        settings={"phases": of.phases, "is_automatic": lambda t: of.is_automatic(t.settings)},
        demand="small",
    ),
    Stage(
        "draw_figures",
        "report:draw_figures",
        "figures",
        of.is_any,
        inputs=("{shown}",),
        outputs=("figures",),
        is_page=True,
    ),
    Stage(
        "write_report",
        "report:write_report",
        "report",
        of.is_any,
        inputs=("{shown}", "figures"),
        outputs=("report",),
        is_page=True,
    ),
)
"""Every stage, and :data:`WHOLE`, which runs all of them in one job."""

WHOLE = Stage(
    IDENTIFICATION,
    "identification:identify",
    "identification",
    of.is_any,
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
