"""A batch: several recordings, one after the other, in one process.

Snakemake sees one job. Within it each recording is a job of its own: it has its log, its checksums
and the record of an unfinished job, fails alone, and is passed over where it is finished already.
"""

import time
from collections.abc import Callable, Mapping
from pathlib import Path

from evopem.config.settings import DatasetSettings
from evopem.errors import InputError
from evopem.files.archive import pack
from evopem.files.atomic import files_below
from evopem.files.checksums import delete_results
from evopem.files.job import job
from evopem.files.json_form import save
from evopem.files.unfinished import unfinished_record
from evopem.pipeline.identification import identify_dataset, made_aside
from evopem.results.identity import MADE_FROM, is_finished, made_from
from evopem.results.layout import IDENTIFICATION, DatasetFiles

Log = Callable[[str], None]
_SHOWN = 5


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
    with job(files.log(IDENTIFICATION), (), files.batch_results, ends_with_parent=False) as logger:
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
