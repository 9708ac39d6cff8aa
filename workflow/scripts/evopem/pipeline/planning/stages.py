"""The stages of an identification: one table for rules, for one process, command and notebook.

A rule of the workflow runs the stage of its name for one data set. Without Snakemake,
:mod:`evopem.pipeline.identification` runs the same ones, in the order that their files ask for.
"""

from collections.abc import Iterable
from functools import partial

from evopem.config import order_grid
from evopem.config.settings import DatasetSettings
from evopem.pipeline.planning import stage as of
from evopem.pipeline.planning.stage import Stage
from evopem.results.layout import IDENTIFICATION, DatasetFiles

PREPARING = ("synthesize", "read_recording", "prepare")
"""Stages that are done for all data sets before any is searched."""


def _automatic(*names: str) -> tuple[str, ...]:
    """Files of the automatic recipe alone."""
    return tuple(f"{name} if automatic" for name in names)


_PREPARED = ("prepared", "transforms")
_VALIDATION = (
    *("validation", "residual_autocorrelation", "cross_correlation", "simulation", "horizons"),
)
_DECIDED = _automatic("decision:preparation", "decision:folds", "decision:delay")
_SCORED = (*_PREPARED, *_DECIDED)
_COMPARED = _automatic("decision:comparison")
_CHOSEN = (*_COMPARED, *_automatic("decision:revisions"))
_SEARCHED = ("phase:{phases}", *_automatic("search:{structures}"))
_OTHER = "validation_recording if source.validation_files"
_OF_RESPONSES = "channels.frequency"
_OF_PAGE = (
    *("recording_info", "model", "validation", "modes", "candidates", "config"),
    *("frequency_response", "time_response", "spectrum"),
)
_OTHER_INFO = "validation_recording_info if source.validation_files"

_reported = partial(
    Stage,
    function="report:write_report",
    title="figures and report",
    seconds=6.0,
    outputs=("figures", "report"),
    is_page=True,
)
_decided = partial(Stage, applies="automatic", demand="estimation")
_searched = partial(Stage, applies="not automatic", demand="estimation")

STAGES = (
    Stage(
        "synthesize",
        "acquisition:synthesize_recording",
        "simulating the recording",
        applies="not source.all_files",
        outputs=("recording", "recording_info", "truth"),
        settings={"source": "source", "transforms": "preparation.transforms"},
    ),
    Stage(
        "read_recording",
        "acquisition:read_recording",
        "reading the recording",
        applies="source.all_files",
        outputs=("recording", "recording_info", _OTHER, _OTHER_INFO),
        given=("channels", "channels_from_file", "geometry"),
        settings={"recorded": "source.files", "validation": "source.validation_files"},
        recorded=("files", "validation_files"),
    ),
    Stage(
        "prepare",
        "preparation:prepare_samples",
        "preparing the samples",
        seconds=2.0,
        inputs=("recording", _OTHER),
        outputs=_SCORED,
        given=("is_validated", "given", "requirements"),
        settings={
            "settings": "preparation",
            "recorded": "source.all_files",
            "fit": of.fit_to_check,
            "delays": lambda job: of.automatic(job).orders.nk,
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
    # Most take less than the start of a process: all in one.
    _decided(
        "search_polynomials",
        "structure_search:search_structures",
        "searching the orders of polynomial models",
        seconds=8.0,
        inputs=_SCORED,
        outputs=("search:{polynomials}", "models_of_orders:{polynomials}"),
        given=("fits",),
        settings={"structures": of.polynomials, "settings": of.orders_of_polynomials},
    ),
    _decided(
        "search_state_space",
        "structure_search:search_structures",
        "searching the orders of {structure} models",
        seconds=1.0,
        inputs=("search:{nested}", *_SCORED),
        outputs=("search:{structure}", "models_of_orders:{structure}"),
        given=("fits", "nested"),
        settings={
            "structures": lambda job: (job.values["structure"],),
            "settings": of.orders_of_states,
        },
        wildcards={"structure": "forms"},
    ),
    _decided(
        "choose",
        "structure_search:choose",
        "comparing the structures",
        seconds=4.0,
        inputs=("search:{wanted}", *_SCORED),
        outputs=_COMPARED,
        given=("fits",),
        settings={"structures": of.wanted, "settings": of.choices("structure", "orders")},
    ),
    _searched(
        "estimate_candidates",
        "order_search:estimate_candidates",
        "searching the orders: {phase}",
        seconds=2.0,
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
        seconds=2.0,
        inputs=("part:{phase},{parts}", *_PREPARED),
        outputs=("phase:{phase}",),
        given=("parts", "search", "window"),
        settings={"grid": of.grid(order_grid.grid_of_selection)},
        wildcards={"phase": "phases"},
    ),
    Stage(
        "complete_model",
        "complete_model:complete_model",
        "model and its uncertainty",
        seconds=7.0,
        inputs=(*_SCORED, *_COMPARED, "phase:{last}"),
        outputs=(
            *("model", "model_mat", "frequency_response", "time_response"),
            *("other_model:{purposes}", "decision:revisions if automatic"),
        ),
        given=("search", "window", "phases", "fit", "fits"),
        settings={
            "settings": of.choices(
                *("purpose", "structure", "orders", "evaluations", "max_root_radius")
            ),
            "others": of.purposes,
            "hold": "continuous_time",
        },
        demand="model",
    ),
    Stage(
        "estimate_varying",
        "varying:estimate_varying",
        "what moves",
        seconds=2.0,
        applies="varying",
        inputs=(*_PREPARED, "model"),
        outputs=("varying", "varying_modes"),
        settings={"settings": "varying"},
        demand="model",
    ),
    Stage(
        "validate",
        "validation:complete_results",
        "validation",
        seconds=0.5,
        inputs=(
            *("truth if not source.all_files", "recording", "recording_info", _OTHER_INFO),
            *("model", "other_model:{purposes}", "frequency_response", "time_response"),
            *(*_SCORED, *_CHOSEN, *_SEARCHED, "models_of_orders:{structures} if automatic"),
            *("varying if varying", "spectrum", "spectrum_summary"),
        ),
        outputs=(
            *_VALIDATION,
            *("modes", "candidates", "decisions if automatic", "summary", "config", "verdict"),
        ),
        given=("phases", "structures"),
        settings={
            "settings": "",
            "phase": lambda job: order_grid.phase_of_orders_of(job.settings),
            "others": of.purposes,
        },
        demand="model",
    ),
    _reported(
        "report",
        inputs=(
            *("truth if not source.all_files", "decisions if automatic", "config", "recording"),
            *("recording_info", _OTHER_INFO, *_PREPARED, "spectrum", "spectrum_summary"),
            *(*_CHOSEN, *_SEARCHED, "candidates", "model", "frequency_response"),
            *("time_response", "varying if varying", *_VALIDATION),
        ),
    ),
    Stage(
        "identify_responses",
        "frequency_responses:identify_responses",
        "fitting the frequency responses",
        seconds=40.0,
        applies=_OF_RESPONSES,
        outputs=("model_mat", "summary", "verdict", *_OF_PAGE),
        settings={"settings": ""},
        recorded=("files",),
        demand="estimation",
    ),
    _reported("report_responses", applies=_OF_RESPONSES, inputs=_OF_PAGE),
)
"""Every stage, and :data:`WHOLE`, which runs all of them in one job."""

WHOLE = Stage(
    IDENTIFICATION,
    "identification:identify_dataset",
    "identification",
    settings={"settings": "", "with_report": lambda job: job.of_run.report == "html"},
    recorded=("files", "validation_files"),
    demand="estimation",
)


def stages_of(settings: DatasetSettings, with_report: bool = True) -> list[Stage]:
    """The stages of a data set, in the order of the table."""
    return [
        stage
        for stage in STAGES
        if (stage.applies == _OF_RESPONSES) == of.holds(_OF_RESPONSES, settings)
        and of.holds(stage.applies, settings)
        and (with_report or not stage.is_page)
    ]


# Share of all work from which on the time left is said, and the seconds of work as measured that
# speak for a machine and a recording like those measured, beside the time that this one took.
_TOLD_FROM, _MEASURED = 0.15, 10.0


def seconds_left(elapsed: float, done: Iterable[str], left: Iterable[str]) -> float | None:
    """About how long the jobs of stages will take, by their weights and the time that others took.

    None while those done are too little of all work.
    """
    of_stage = {stage.name: stage.seconds for stage in STAGES}
    worked, ahead = (sum(of_stage.get(name, 0.1) for name in names) for names in (done, left))
    slowness = (elapsed + _MEASURED) / (worked + _MEASURED)
    return slowness * ahead if worked > _TOLD_FROM * (worked + ahead) else None


def left_in_words(seconds: float | None) -> str:
    """Such as ``about 40 s left``; empty where it is not known."""
    if seconds is None:
        return ""
    unit, size = ("h", 3600) if seconds > 5400 else ("min", 60) if seconds > 90 else ("s", 1)
    return f"about {max(1, round(seconds / size))} {unit} left"


def results_of(settings: DatasetSettings, files: DatasetFiles, with_report: bool) -> list[str]:
    """Every result of a data set, those that only other stages read among them."""
    return [
        path
        for stage in stages_of(settings, with_report)
        if not stage.is_part
        for job in stage.jobs(settings, files)
        for path in job.made
    ]
