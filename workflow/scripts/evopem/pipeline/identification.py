"""Identification: every stage of one data set, in their order, in one process.

Snakemake schedules the same stages as separate jobs, or this whole sequence as one job.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from evopem.automatic.preparation import GivenPreparation
from evopem.config.order_grid import (
    given_preparation,
    phase_of_orders_of,
    phases_of_dataset,
    sample_requirements,
    scoring_window,
)
from evopem.config.settings import AutomaticSettings, DatasetSettings, RecordedSource
from evopem.config.structures import searched_structures
from evopem.config.yaml_form import read_settings
from evopem.pipeline.acquisition import read_recording
from evopem.pipeline.automatic_model import (
    collect_decisions,
    complete_other_model,
    estimate_chosen,
)
from evopem.pipeline.automatic_preparation import apply_preparation, decide_preparation
from evopem.pipeline.automatic_search import (
    act_on_checks,
    compare_structures,
    decide_delay,
    decide_folds,
    search_structure,
)
from evopem.pipeline.candidates import tabulate_candidates
from evopem.pipeline.configuration import write_configuration
from evopem.pipeline.model import complete_model
from evopem.pipeline.order_search import Log, estimate_candidates, select_candidate
from evopem.pipeline.preparation import prepare_signals
from evopem.pipeline.progress import Announce, Stage, run_stages
from evopem.pipeline.spectrum import estimate_spectrum
from evopem.pipeline.summary import summarize_dataset
from evopem.pipeline.synthesis import synthesize_recording
from evopem.pipeline.validation import validate_model
from evopem.results.layout import DatasetFiles


def stages(
    files: DatasetFiles,
    settings: DatasetSettings,
    log: Log | None = None,
    cores: int = 1,
    folder: str | Path = "",
) -> dict[str, Stage]:
    """List the stages of a data set by their names, in their order, ready to be called.

    Parameters are those of :func:`identify_recording`.
    """
    automatic = settings.automatic
    window = None if automatic else scoring_window(settings)
    phases = phases_of_dataset(settings)
    return {
        "configuration": partial(write_configuration, files, settings),
        **_acquisition(files, settings, folder),
        **(
            _automatic_stages(files, settings, automatic, log)
            if automatic
            else _stages_of_the_chapter(files, settings, log, cores)
        ),
        "model": partial(complete_model, files, settings.search, window, phases, settings.fit),
        "candidates": partial(tabulate_candidates, files, phases),
        "validation": partial(validate_model, files, phase_of_orders_of(settings)),
        "summary": partial(summarize_dataset, files, phases),
        "figures": partial(_draw_figures, files),
        "report": partial(_write_report, files),
    }


def _stages_of_the_chapter(
    files: DatasetFiles, settings: DatasetSettings, log: Log | None, cores: int
) -> dict[str, Stage]:
    """From the recording to the selection of the last phase."""
    listed: dict[str, Stage] = {
        "preparation": partial(
            prepare_signals,
            files,
            settings.preparation,
            sample_requirements(settings),
            _is_validated(settings),
            (settings.fit, settings.order_grid) if settings.fit.changes_model else None,
            settings.source.all_files,
        ),
        "spectrum": partial(estimate_spectrum, files, settings.spectrum),
    }
    for phase in phases_of_dataset(settings):
        listed[phase] = partial(_search_phase, files, phase, settings, log, cores)
    return listed


def _automatic_stages(
    files: DatasetFiles, settings: DatasetSettings, automatic: AutomaticSettings, log: Log | None
) -> dict[str, Stage]:
    """From the recording to the chosen model, one stage for each decision."""
    given = GivenPreparation(**given_preparation(settings.preparation, automatic))  # type: ignore[arg-type]
    preparation, validated = settings.preparation, _is_validated(settings)
    searched = searched_structures(automatic.structure)
    other = automatic.other_purpose
    wanted = (automatic.structure,) if automatic.structure else searched
    listed: dict[str, Stage] = {
        "plan": partial(
            decide_preparation, files, preparation, given, validated, settings.source.all_files
        ),
        "preparation": partial(apply_preparation, files, preparation, validated),
        "spectrum": partial(estimate_spectrum, files, settings.spectrum),
        "folds": partial(decide_folds, files),
        "delay": partial(decide_delay, files, automatic.nk),
    }
    for structure in searched:
        listed[structure] = partial(search_structure, files, structure, automatic)
    return listed | {
        "structures": partial(compare_structures, files, wanted, automatic),
        "remedies": partial(act_on_checks, files, automatic),
        "chosen": partial(estimate_chosen, files, settings.search, log),
        "other_model": partial(complete_other_model, files, other, settings.search),
        "decisions": partial(collect_decisions, files, searched, other),
    }


def _is_validated(settings: DatasetSettings) -> bool:
    """Whether there is an independent recording for validation."""
    source = settings.source
    return isinstance(source, RecordedSource) and bool(source.validation_files)


def identify_recording(
    files: DatasetFiles,
    settings: DatasetSettings,
    with_report: bool,
    log: Log | None = None,
    cores: int = 1,
    announce: Announce | None = None,
    folder: str | Path = "",
) -> None:
    """Take one data set from its recording to its results.

    Parameters
    ----------
    files : DatasetFiles
    settings : DatasetSettings
    with_report : bool
        Whether figures and report are made.
    log : callable, optional
        Receives progress in words.
    cores : int
    announce : callable, optional
        Receives each stage before it begins: its name, its number from 1, and how many there are.
    folder : path
        What relative paths of recorded files are relative to; the working directory by default.
    """
    listed = {
        name: stage
        for name, stage in stages(files, settings, log, cores, folder).items()
        if with_report or name not in ("figures", "report")
    }
    run_stages(listed, announce)


def run_stage(name: str, folder: str | Path, log: Log | None = print) -> None:
    """Run one stage again on the files of a data set's folder, without Snakemake.

    Parameters
    ----------
    name : str
        A name that :func:`stages` lists, such as ``"validation"``.
    folder : path
        The data set's folder of results, with its ``config.yaml``.
    log : callable, optional
        Receives progress.
    """
    files = DatasetFiles(str(folder))
    stages(files, read_settings(files.config), log)[name]()


def _acquisition(
    files: DatasetFiles, settings: DatasetSettings, folder: str | Path
) -> dict[str, Stage]:
    source = settings.source
    if not isinstance(source, RecordedSource):
        transforms = settings.preparation.transforms
        return {"recording": partial(synthesize_recording, files, source, transforms)}
    reading: dict[str, Stage] = {
        "recording": partial(
            read_recording,
            *(source.files, source.channels, files.recording, files.recording_info, folder),
            source.channels_from_file,
        )
    }
    if source.validation_files:
        reading["validation_recording"] = partial(
            read_recording,
            source.validation_files,
            source.channels,
            files.validation_recording,
            files.validation_recording_info,
            folder,
            source.channels_from_file,
            files.recording_info,
        )
    return reading


def _search_phase(
    files: DatasetFiles, phase: str, settings: DatasetSettings, log: Log | None, cores: int
) -> None:
    window, search, grid = scoring_window(settings), settings.search, settings.order_grid
    estimate_candidates(files, phase, 1, 1, grid, search, window, log, cores)
    select_candidate(files, phase, 1, grid, search, window, log)
    Path(files.part(phase, 1)).unlink()  # the file of the phase holds all of it


# Drawing is imported where it is used: a fleet without reports spares the time of matplotlib.
def _draw_figures(files: DatasetFiles) -> None:
    from evopem.pipeline.figures import draw_figures

    draw_figures(files)


def _write_report(files: DatasetFiles) -> None:
    from evopem.pipeline.report import write_report
    from evopem.report.templates import template_folder

    write_report(files, template_folder())
