"""Identification: every stage of one data set in one process, without Snakemake."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evopem.config.defaults import read_settings
from evopem.config.settings import DatasetSettings
from evopem.errors import InputError
from evopem.files.atomic import TEMPORARY, files_below
from evopem.files.checksums import delete_results
from evopem.pipeline.call import Log
from evopem.pipeline.planning.stage import StageJob
from evopem.pipeline.planning.stages import stages_of
from evopem.pipeline.progress import Announce
from evopem.results.layout import IDENTIFICATION, DatasetFiles


def jobs(
    settings: DatasetSettings, files: DatasetFiles, with_report: bool = True
) -> list[StageJob]:
    """Every job of a data set, each behind those whose results it reads."""
    stages = stages_of(settings, with_report)
    waiting = [job for stage in stages for job in stage.jobs(settings, files)]
    listed = []
    missing = {path for job in waiting for path in job.made}
    while waiting:
        ready = next(job for job in waiting if missing.isdisjoint(job.read))
        waiting.remove(ready)
        missing.difference_update(ready.made)
        listed.append(ready)
    return listed


def identify_dataset(
    files: DatasetFiles,
    settings: DatasetSettings,
    with_report: bool,
    log: Log | None = None,
    cores: int = 1,
    announce: Announce | None = None,
    folder: str | Path = "",
) -> None:
    """Take one data set from its recording to its results."""
    listed = jobs(settings, files, with_report)
    for number, job in enumerate(listed, start=1):
        if announce is not None:
            announce(job.words, number, len(listed))
        job.run(log, cores, folder)
    remove_parts(listed)


@contextmanager
def made_aside(files: DatasetFiles) -> Iterator[DatasetFiles]:
    """Where results are made until all are there; what is left of them at the end is deleted."""
    work = Path(files.folder) / f"{TEMPORARY}{IDENTIFICATION}"
    shutil.rmtree(work, ignore_errors=True)  # of a process that was killed
    try:
        # Sentences name the data set by its folder.
        yield DatasetFiles(str(work / files.name))
    finally:
        shutil.rmtree(work, ignore_errors=True)


def exchange(made: DatasetFiles, files: DatasetFiles) -> None:
    """Put results that were made aside in the place of earlier ones."""
    delete_results(files.folder)
    for file in files_below(made.folder, ""):
        place = Path(files.folder) / file.relative_to(made.folder)
        place.parent.mkdir(parents=True, exist_ok=True)
        file.replace(place)


def remove_parts(listed: list[StageJob]) -> None:
    """Delete the parts of results that the results of other stages hold as a whole."""
    for path in (path for job in listed if job.stage.is_part for path in job.made):
        Path(path).unlink()


def run_stage(name: str, folder: str | Path, log: Log | None = print) -> None:
    """Run one stage again on the files of a data set's folder, without Snakemake."""
    files = DatasetFiles(str(folder))
    listed = jobs(read_settings(files.config), files)
    wanted = [job for job in listed if name in (job.name, job.stage.name)]
    if not wanted:
        names = ", ".join(dict.fromkeys(job.stage.name for job in listed))
        problem = f"{name!r} is no stage of {files.name}"
        raise InputError("run_stage", problem, f"give one of {names}")
    read = {path for job in wanted for path in job.read}
    parts = [
        job
        for job in listed
        if job.stage.is_part and job not in wanted and not read.isdisjoint(job.made)
    ]
    for job in parts + wanted:
        job.run(log)
    remove_parts(parts)
