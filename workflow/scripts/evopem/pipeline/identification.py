"""Identification: every stage of a data set in one process, without Snakemake, and batches.

Snakemake sees a batch as one job.  In it each recording is a job of its own: it has its log, its
checksums and the record of an unfinished job, fails alone, and is passed over where it is finished.
"""

import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from evopem.config.defaults import read_settings
from evopem.config.settings import DatasetSettings
from evopem.errors import InputError
from evopem.files.atomic import TEMPORARY, files_below, pack
from evopem.files.checksums import delete_results
from evopem.files.job import job as recorded_job
from evopem.files.job import unfinished_record
from evopem.files.json_form import save
from evopem.pipeline.call import Log
from evopem.pipeline.planning.stage import StageJob
from evopem.pipeline.planning.stages import left_in_words, seconds_left, stages_of
from evopem.results.identity import MADE_FROM, is_finished, made_from
from evopem.results.layout import IDENTIFICATION, DatasetFiles

Announce = Callable[[Sequence[StageJob], int], None]

# Seconds between two lines about one stage where there is no terminal; characters of the bar;
# failed recordings that are named.
PAUSE, BAR, _SHOWN = 30.0, 10, 5


@dataclass
class ProgressLine:
    """One line that each stage overwrites, or a line for each stage."""

    stream: TextIO  # of a terminal standard error, so that the results alone can be piped on
    overwrites: bool  # as a terminal does
    _started: float = field(default_factory=time.monotonic)
    _shown: float = 0.0
    _stage: tuple[str, str] = ("", "")
    _end: float | None = None  # when all stages are expected to be done
    _width: int = 0

    def announce(self, listed: Sequence[StageJob], done: int) -> None:
        """Say that a job begins, what it does, and about how long it and those behind it take."""
        bar = f"{'#' * (BAR * done // len(listed)):.<{BAR}}"
        self._stage = f"{bar} [{done + 1}/{len(listed)}]", listed[done].words
        now, names = time.monotonic(), [job.stage.name for job in listed]
        left = seconds_left(now - self._started, names[:done], names[done:])
        self._end = None if left is None else now + left
        self._show("")

    def tell(self, words: str) -> None:
        """Say how far the stage has come; not each time where lines are kept."""
        if self.overwrites or time.monotonic() - self._shown >= PAUSE:
            self._show(f": {words}")

    def _show(self, words: str) -> None:
        self._shown = time.monotonic()
        number, title = self._stage
        left = left_in_words(None if self._end is None else self._end - self._shown)
        text = (
            f"{number} {self._shown - self._started:5.1f} s{left and f', {left}'}  {title}{words}"
        )
        if not self.overwrites:
            self.stream.write(f"{text}\n")
        else:
            # A line that is wrapped could not be overwritten.
            text = text[: shutil.get_terminal_size().columns - 1]
            self.stream.write(f"\r{text:<{self._width}}")
            self._width = len(text)
        self.stream.flush()

    def close(self) -> None:
        """Remove the line from the terminal."""
        if self.overwrites and self._width:
            self.stream.write(f"\r{'':<{self._width}}\r")
            self.stream.flush()


@contextmanager
def progress(shown: bool) -> Iterator[Announce | None]:
    """A function that is called before each job begins; None where nothing is shown."""
    if not shown:
        yield None
        return
    # A notebook overwrites a line as a terminal does, and shows standard error as a fault.
    ipython = sys.modules.get("IPython")
    in_notebook = ipython is not None and hasattr(ipython.get_ipython(), "kernel")
    stream = sys.stdout if in_notebook else sys.stderr
    line = ProgressLine(stream, in_notebook or stream.isatty())
    try:
        yield line.announce
    finally:
        line.close()


def jobs(
    settings: DatasetSettings, files: DatasetFiles, with_report: bool = True
) -> list[StageJob]:
    """Every job of a data set, each behind those whose results it reads."""
    stages = stages_of(settings, with_report)
    waiting = [job for stage in stages for job in stage.jobs(settings, files) if job.made]
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
    for done, job in enumerate(listed):
        if announce is not None:
            announce(listed, done)
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


def put_in_place(made: DatasetFiles, files: DatasetFiles) -> None:
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


def identify_batch(
    folder: str | Path,
    recordings: Mapping[str, DatasetSettings],
    code: str,
    log: Log,
    cores: int = 1,
) -> None:
    """Identify recordings one after the other, each whatever becomes of the others.

    Each keeps :attr:`.DatasetFiles.batch_results`, with all that is not among them in an archive.
    One whose process was killed before is tried after all others, because it may be again. At the
    end an `InputError` names those that failed; their messages are on standard error and in logs.
    """
    failed = []
    for name in _killed_last(folder, recordings):
        files, settings = DatasetFiles(f"{folder}/{name}"), recordings[name]
        if is_finished(files, settings, code):
            log(f"{name}: finished before")
            continue
        began = time.monotonic()
        try:
            _identify(files, settings, code, cores)
        # Exit is how the job of a recording ends at an error that it has explained.
        except (Exception, SystemExit):
            record = unfinished_record(IDENTIFICATION, files.logs)
            log(f"{name}: failed. {record.sentence if record else ''}")
            failed.append(name)
        else:
            log(f"{name}: complete after {time.monotonic() - began:.1f} s")
    if failed:
        shown = ", ".join([*failed[:_SHOWN], *(["…"] if len(failed) > _SHOWN else [])])
        problem = f"{len(failed)} of the {len(recordings)} recordings of this job failed ({shown})"
        raise InputError(str(folder), problem, "see the message of each one")


def _identify(files: DatasetFiles, settings: DatasetSettings, code: str, cores: int) -> None:
    """Take one recording through all stages, and pack what is not looked at every day."""
    with recorded_job(
        files.log(IDENTIFICATION), (), files.batch_results, ends_with_parent=False
    ) as logger:
        delete_results(files.folder)  # nothing of an earlier run is left if this one fails
        with made_aside(files) as aside:
            save(made_from(settings, code), f"{aside.folder}/{MADE_FROM}")
            identify_dataset(aside, settings, with_report=False, log=logger.info, cores=cores)
            _keep(aside, files)


def _keep(made: DatasetFiles, files: DatasetFiles) -> None:
    """Move the results of a batch to their places, all others into the archive among them."""
    moved = dict(zip(map(Path, made.batch_results), files.batch_results, strict=True))
    others = [file for file in files_below(made.folder, "") if file not in moved]
    pack(made.details, others, made.folder)
    for file, place in moved.items():
        file.replace(place)


def _killed_last(folder: str | Path, names: Mapping[str, object]) -> list[str]:
    """Names in their order, last those whose last job left a record without a message."""

    def was_killed(name: str) -> bool:
        record = unfinished_record(IDENTIFICATION, DatasetFiles(f"{folder}/{name}").logs)
        return record is not None and record.message is None

    return sorted(names, key=was_killed)
