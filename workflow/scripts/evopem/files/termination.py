"""The end of a run: jobs end with the Snakemake that started them, whatever ends it."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import NoReturn

_SECONDS_BETWEEN_LOOKS = 1.0


def end_with_parent() -> None:
    """End this process when its parent process ends, even by a signal that it cannot handle.

    A job that went on alone would write into results that another run has begun to make.
    """
    parent = os.getppid()
    threading.Thread(target=_wait_for_end, args=(parent,), daemon=True).start()


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
        try:
            job.terminate()
        except psutil.NoSuchProcess:
            continue
    raise KeyboardInterrupt


def _wait_for_end(parent: int) -> NoReturn:
    while os.getppid() == parent:
        time.sleep(_SECONDS_BETWEEN_LOOKS)
    os._exit(1)
