"""Identification: every stage of one data set, in their order, in one process.

Snakemake schedules the same stages as separate jobs, or this whole sequence as one job.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from evopem.config.order_grid import phase_of_orders, sample_requirements, scoring_window
from evopem.config.settings import DatasetSettings, RecordedSource
from evopem.config.structures import phases_of
from evopem.config.yaml_form import read_settings
from evopem.pipeline.acquisition import read_recording
from evopem.pipeline.candidates import tabulate_candidates
from evopem.pipeline.configuration import write_configuration
from evopem.pipeline.model import complete_model
from evopem.pipeline.order_search import Log, estimate_candidates, select_candidate
from evopem.pipeline.preparation import prepare_signals
from evopem.pipeline.spectrum import estimate_spectrum
from evopem.pipeline.summary import summarize_dataset
from evopem.pipeline.synthesis import synthesize_recording
from evopem.pipeline.validation import validate_model
from evopem.results.layout import DatasetFiles

Stage = Callable[[], None]
Announce = Callable[[str, int, int], None]


def stages(
    files: DatasetFiles, settings: DatasetSettings, log: Log | None = None, cores: int = 1
) -> dict[str, Stage]:
    """List the stages of a data set by their names, in their order, ready to be called."""
    window, search = scoring_window(settings), settings.search
    structure = settings.order_grid.structure
    phases = phases_of(structure)
    validated = isinstance(settings.source, RecordedSource) and settings.source.validation_file
    listed: dict[str, Stage] = {
        "configuration": partial(write_configuration, files, settings),
        **_acquisition(files, settings),
        "preparation": partial(
            prepare_signals,
            files,
            settings.preparation,
            sample_requirements(settings),
            bool(validated),
            (settings.fit, settings.order_grid) if settings.fit.changes_model else None,
        ),
        "spectrum": partial(estimate_spectrum, files, settings.spectrum),
    }
    for phase in phases:
        listed[phase] = partial(_search_phase, files, phase, settings, log, cores)
    return listed | {
        "model": partial(complete_model, files, search, window, phases, settings.fit),
        "candidates": partial(tabulate_candidates, files, phases),
        "validation": partial(validate_model, files, phase_of_orders(structure)),
        "summary": partial(summarize_dataset, files, phases),
        "figures": partial(_draw_figures, files),
        "report": partial(_write_report, files),
    }


def identify_recording(
    files: DatasetFiles,
    settings: DatasetSettings,
    with_report: bool,
    log: Log | None = None,
    cores: int = 1,
    announce: Announce | None = None,
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
    """
    listed = {
        name: stage
        for name, stage in stages(files, settings, log, cores).items()
        if with_report or name not in ("figures", "report")
    }
    for number, (name, stage) in enumerate(listed.items(), start=1):
        if announce is not None:
            announce(name, number, len(listed))
        stage()


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


def _acquisition(files: DatasetFiles, settings: DatasetSettings) -> dict[str, Stage]:
    source = settings.source
    if not isinstance(source, RecordedSource):
        transforms = settings.preparation.transforms
        return {"recording": partial(synthesize_recording, files, source, transforms)}
    reading: dict[str, Stage] = {
        "recording": partial(
            read_recording, source.file, source.channels, files.recording, files.recording_info
        )
    }
    if source.validation_file:
        reading["validation_recording"] = partial(
            read_recording,
            source.validation_file,
            source.channels,
            files.validation_recording,
            files.validation_recording_info,
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
