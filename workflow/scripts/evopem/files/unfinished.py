"""Records of jobs that were started and have not succeeded.

A job writes its record when it starts, adds the message of its error when it fails, and deletes the
record when it succeeds. A job that is killed therefore leaves a record without a message.
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from evopem.errors import InputError
from evopem.files.atomic import files_below
from evopem.files.checksums import program_of, verify_checksums
from evopem.files.json_form import load, save

_ENDING = ".unfinished.json"


@dataclass(frozen=True)
class UnfinishedJob:
    """A job that was started and has not succeeded."""

    job: str  # path of its log file below the folder ``logs``, without the ending
    outputs: tuple[str, ...]  # relative to the folder beside ``logs``
    message: str | None = None  # of its error; None while it runs and after it was killed

    @property
    def sentence(self) -> str:
        """What is known of why it has not succeeded."""
        return self.message or (
            f"the job {self.job} ended without a message, as a job that is killed does; run"
            f" {program_of(self.job)} again."
        )

    def save(self, logs: str | Path) -> None:
        """Write the record into the folder of its log."""
        save(self, _file(self.job, logs))

    def delete(self, logs: str | Path) -> None:
        """Delete the record."""
        _file(self.job, logs).unlink(missing_ok=True)


def start_record(record: UnfinishedJob, logs: str | Path) -> None:
    """Write the record of a job that starts, and delete the records that it makes obsolete.

    These are the records of jobs that make the same outputs, or parts of them, when the workflow is
    divided differently. The parts of ``phases/delay.json`` lie in the folder ``phases/delay``.
    """
    made = {Path(output) for output in record.outputs}
    made |= {output.with_suffix("") for output in made}
    for earlier in _read(Path(logs)):
        if all({Path(output), *Path(output).parents} & made for output in earlier.outputs):
            earlier.delete(logs)
    record.save(logs)


def unfinished_jobs(logs: str | Path, summary: str = "") -> list[UnfinishedJob]:
    """The unfinished jobs of which an output is missing, the newest record first.

    ``summary``: the result that is made last, relative to the folder beside ``logs``. Where it
    exists, jobs that ended before it was made, and do not make it, are left out: an earlier
    configuration had them.
    """
    logs = Path(logs)
    last = logs.parent / summary
    since = last.stat().st_mtime_ns if summary and last.is_file() else 0
    records = [
        record
        for record in _read(logs)
        if not (record.outputs and all((logs.parent / y).exists() for y in record.outputs))
        and (summary in record.outputs or _written(record, logs) >= since)
    ]
    return sorted(records, key=lambda record: _written(record, logs), reverse=True)


def check_result(path: str | Path) -> None:
    """Refuse a result that was changed after its job wrote it, or whose job has not ended.

    A file that no job wrote passes, and a link to a result is that result.
    """
    for file in dict.fromkeys([Path(path), Path(os.path.realpath(path))]):
        verify_checksums([file], file.parent)
        for job in unfinished_jobs(file.parent / "logs", "summary.json"):
            if file.name in job.outputs:
                problem = f"is of an unfinished run ({job.sentence})"
                raise InputError(str(file), problem, "run it again")


def unfinished_record(job: str, logs: str | Path) -> UnfinishedJob | None:
    """The record of a job that was started and has not succeeded; None where there is none."""
    file = _file(job, logs)
    try:
        return load(UnfinishedJob, file) if file.exists() else None
    except InputError:  # damaged, as by a power failure
        return UnfinishedJob(job, ())


def _written(record: UnfinishedJob, logs: Path) -> int:
    try:
        return _file(record.job, logs).stat().st_mtime_ns
    except OSError:  # another job has just deleted it
        return 0


def _file(job: str, logs: str | Path) -> Path:
    return Path(logs) / f"{job}{_ENDING}"


def _read(logs: Path) -> Iterator[UnfinishedJob]:
    """All records; one that another job has just deleted, or that is damaged, is left out."""
    for file in files_below(logs, _ENDING):
        with suppress(InputError):
            yield load(UnfinishedJob, file)
