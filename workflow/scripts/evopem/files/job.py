"""What a job says: progress into its log file, and a user's mistake in one sentence."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from evopem.errors import InputError
from evopem.files.checksums import check_seals, seal


@contextmanager
def job(
    log_file: str | Path,
    inputs: Iterable[str | Path] = (),
    outputs: Iterable[str | Path] = (),
) -> Iterator[logging.Logger]:
    """Run a job's work on results that are as they were written, its messages in a log file.

    An `InputError`, and memory that runs out, end the process with exit code 1 and a sentence on
    standard error and in the log; any other error leaves its traceback there as well.

    Parameters
    ----------
    log_file : path
        Created with its folder, or overwritten; somewhere below a folder ``logs``, beside which
        the outputs lie, where there are any.
    inputs : iterable of path
        Checked against their seals before the work begins.
    outputs : iterable of path
        Sealed when it is done.

    Yields
    ------
    logging.Logger
        The package's logger, for progress.
    """
    log_file = Path(log_file)
    log_file.parent.mkdir(parents=True, exist_ok=True)
    # A log that cannot be written must not hide what the job says.
    logging.raiseExceptions = False
    logger = logging.getLogger("evopem")
    warnings = logging.getLogger("py.warnings")
    logging.captureWarnings(True)
    handler = logging.FileHandler(log_file, mode="w", encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    logger.setLevel(logging.INFO)
    for each in (logger, warnings):
        each.addHandler(handler)
    try:
        check_seals(inputs)
        yield logger
        if outputs:
            seal(outputs, next(up.parent for up in log_file.parents if up.name == "logs"))
    except (InputError, MemoryError) as error:
        sentence = _too_little_memory(log_file) if isinstance(error, MemoryError) else error
        logger.error("%s", sentence)
        # In one piece: jobs that fail side by side share the terminal.
        sys.stderr.write(f"{sentence}\n")
        sys.exit(1)
    except BaseException:
        logger.exception("The job failed.")
        raise
    finally:
        for each in (logger, warnings):
            each.removeHandler(handler)
        handler.close()
        logging.captureWarnings(False)


def _too_little_memory(log_file: Path) -> InputError:
    return InputError(
        str(log_file.with_suffix("")),
        "this job needs more memory than it may have",
        "run fewer jobs at once, raise its limit or its mem_mb, or shorten the recording",
    )
