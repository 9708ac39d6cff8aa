"""A part of an order search on several cores: each process estimates one order after the other.

An estimate depends on its order and the data alone, so sharing the work changes no bit.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import NamedTuple

from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.errors import InputError
from evopem.estimation.candidate import Candidate
from evopem.estimation.order_selection import estimate_candidates
from evopem.models.structures import Orders
from evopem.signals.recording import Recording


class _Task(NamedTuple):
    """What all estimates of a process share."""

    data: Recording
    phase: str
    settings: SearchSettings
    window: ScoringWindow
    level: bool


def estimate_in_parallel(
    data: Recording,
    orders: Sequence[Orders],
    phase: str,
    settings: SearchSettings,
    window: ScoringWindow,
    log: Callable[[str], None] | None = None,
    cores: int = 1,
    level: bool = False,
) -> list[Candidate]:
    """Estimate every order of a phase, on several cores where there are some.

    On several cores the log is the package's logger.  Returns in the order of ``orders``.
    InputError when the record is too short for an order, or a process was killed.
    """
    if cores <= 1 or len(orders) <= 2:
        return estimate_candidates(data, orders, phase, settings, window, log, level)
    # The largest go first, so that no core is left with one of them at the end. The smallest is
    # estimated here: it loads the compiled kernels, which forked processes then share.
    smallest, *others = sorted(range(len(orders)), key=lambda index: orders[index].parameters)
    first = estimate_candidates(data, [orders[smallest]], phase, settings, window, log, level)
    found = {smallest: first}
    # Elsewhere than on Linux forking is unsafe.
    start = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    task = _Task(data, phase, settings, window, level)
    try:
        with ProcessPoolExecutor(min(cores, len(others)), start, _prepare, (task,)) as pool:
            running = {index: pool.submit(_estimate, orders[index]) for index in reversed(others)}
            found |= {index: estimate.result() for index, estimate in running.items()}
    except BrokenProcessPool:
        raise InputError(
            f"the candidates of phase {phase}",
            "a process that estimates them was killed, as a system without memory does",
            "run again with fewer cores or jobs, or with more memory",
        ) from None
    return [candidate for index in range(len(orders)) for candidate in found[index]]


_tasks: list[_Task] = []


def _prepare(task: _Task) -> None:
    """Keep the task of this process, and end the process when its parent ends."""
    _tasks[:] = [task]
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _estimate(order: Orders) -> list[Candidate]:
    task = _tasks[0]
    log = logging.getLogger("evopem").info
    return estimate_candidates(
        task.data, [order], task.phase, task.settings, task.window, log, task.level
    )
