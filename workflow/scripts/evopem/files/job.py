"""The frame of a job: log file, error messages, checksums, and the record of an unfinished job.

A job writes its record when it starts, adds the message of its error when it fails, and deletes the
record when it succeeds. A job that is killed therefore leaves a record without a message.
"""

import gc
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from evopem.errors import InputError
from evopem.files.atomic import files_below, not_written
from evopem.files.checksums import program_of, verify_checksums, write_checksums
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


def end_with_parent() -> None:
    """End this process when its parent process ends, even by a signal that it cannot handle.

    A job that went on alone would write into results that another run has begun to make.
    """
    parent = os.getppid()

    def wait() -> NoReturn:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def interrupt_on_hangup() -> None:
    """Let a hang-up end this process as an interruption does: jobs stop, and locks are removed.

    A terminal that is closed sends SIGHUP, at which a process ends at once. A signal that is
    ignored, as by ``nohup``, stays ignored.
    """
    hangup = getattr(signal, "SIGHUP", None)  # Windows has none
    is_main_thread = threading.current_thread() is threading.main_thread()
    if hangup and is_main_thread and signal.getsignal(hangup) is signal.SIG_DFL:
        signal.signal(hangup, _interrupt)


def _interrupt(*_: object) -> NoReturn:
    # Jobs end with this process; Snakemake waits for them where they do not.
    import psutil

    for job in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            job.terminate()
    raise KeyboardInterrupt


@contextmanager
def only_run(folder: str | Path) -> Iterator[None]:
    """Refuse to work in a folder of results in which another process does, until that ends."""
    with ExitStack() as opened:
        try:
            import fcntl

            Path(folder).mkdir(parents=True, exist_ok=True)
            held = os.open(folder, os.O_RDONLY)
            opened.callback(os.close, held)
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            remedy = "wait until it has ended, or choose another folder"
            raise InputError(str(folder), "another run writes results there", remedy) from None
        except (ImportError, OSError):  # Windows; no locks; of a folder the job says what is wrong
            pass
        yield


@contextmanager
def job(
    log_file: str | Path,
    inputs: Iterable[str | Path] = (),
    outputs: Iterable[str | Path] = (),
    ends_with_parent: bool = True,
) -> Iterator[logging.Logger]:
    """Run the work of a job, with its messages in a log file; yields the package's logger.

    An `InputError`, or a lack of memory, ends the process with exit code 1 and one sentence.
    ``inputs`` are verified first, and the checksums of ``outputs`` written last.
    ``ends_with_parent``: as a job of Snakemake must; a command may outlive its terminal.
    """
    log_file = Path(log_file)
    logs = next(up for up in log_file.parents if up.name == "logs")
    read, made = list(inputs), [Path(output) for output in outputs]
    record = UnfinishedJob(
        job=log_file.relative_to(logs).with_suffix("").as_posix(),
        outputs=tuple(output.relative_to(logs.parent).as_posix() for output in made),
    )

    def fail(error: InputError) -> None:
        # On a full disk the record stays as it was written at the start, without a message.
        with suppress(InputError):
            replace(record, message=str(error)).save(logs)
        # One call: jobs that fail at the same time share the terminal.
        sys.stderr.write(f"{error}\n")
        sys.exit(1)

    # Look for unreachable cycles less often: by default that is a twentieth of a short job.
    gc.set_threshold(100_000, 20, 100)
    if ends_with_parent:
        end_with_parent()
    try:
        start_record(record, logs)
        handler = _log_handler(log_file)
    except InputError as error:
        fail(error)
    with _attached(handler) as logger:
        try:
            verify_checksums(read, logs.parent)
            yield logger
            write_checksums(made, logs.parent, record.job, read)
            record.delete(logs)
        except (InputError, MemoryError) as error:
            if isinstance(error, MemoryError):
                problem = "this job needs more memory than is available"
                remedy = "run fewer jobs at once, raise its mem_mb, or shorten the recording"
                error = InputError(str(logs.parent / record.job), problem, remedy)
            logger.error("%s", error)
            fail(error)
        except BaseException as error:
            logger.exception("The job failed.")
            said = f"the job failed with {type(error).__name__}; its log says more"
            if isinstance(error, KeyboardInterrupt):
                said = f"the job was interrupted; run {program_of(record.job)} again"
            with suppress(InputError):
                replace(record, message=f"{log_file}: {said}.").save(logs)
            raise


def _log_handler(log_file: Path) -> logging.FileHandler:
    try:
        log_file.parent.mkdir(parents=True, exist_ok=True)
        handler = logging.FileHandler(log_file, mode="w", encoding="utf-8")
    except OSError as error:
        raise not_written(log_file, error) from None
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    return handler


@contextmanager
def _attached(handler: logging.Handler) -> Iterator[logging.Logger]:
    """Send the messages of the package, and all warnings, to a handler. Within the job of a batch,
    those of a recording go to its own log and not to the batch's."""
    # A message that cannot be logged must not put a traceback on standard error.
    logging.raiseExceptions = False
    logger = logging.getLogger("evopem")
    warnings = logging.getLogger("py.warnings")
    logging.captureWarnings(True)
    logger.setLevel(logging.INFO)
    before = [(listener, listener.handlers) for listener in (logger, warnings)]
    for listener, kept in before:
        others = [attached for attached in kept if not isinstance(attached, logging.FileHandler)]
        listener.handlers = [*others, handler]
    try:
        yield logger
    finally:
        for listener, kept in before:
            listener.handlers = kept
        # On a full disk the last messages cannot be written; the job's own error is shown.
        with suppress(OSError):
            handler.close()
        logging.captureWarnings(bool(warnings.handlers))
