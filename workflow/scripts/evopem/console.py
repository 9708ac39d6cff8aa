"""What a job says: progress into its log file, and a user's mistake in one sentence."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evopem.errors import InputError


@contextmanager
def job(log_file: str | Path) -> Iterator[logging.Logger]:
    """Run a job's work, its messages and warnings written to a log file.

    An `InputError` ends the process with exit code 1 and its sentence on standard error and in
    the log; any other error leaves its traceback there as well.

    Parameters
    ----------
    log_file : path
        Created with its folder, or overwritten.

    Yields
    ------
    logging.Logger
        The package's logger, for progress.
    """
    Path(log_file).parent.mkdir(parents=True, exist_ok=True)
    logger = logging.getLogger("evopem")
    warnings = logging.getLogger("py.warnings")
    logging.captureWarnings(True)
    handler = logging.FileHandler(log_file, mode="w", encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    logger.setLevel(logging.INFO)
    for each in (logger, warnings):
        each.addHandler(handler)
    try:
        yield logger
    except InputError as error:
        logger.error("%s", error)
        print(error, file=sys.stderr)
        sys.exit(1)
    except BaseException:
        logger.exception("The job failed.")
        raise
    finally:
        for each in (logger, warnings):
            each.removeHandler(handler)
        handler.close()
        logging.captureWarnings(False)
