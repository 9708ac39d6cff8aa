"""A part of a sweep on several cores: each process estimates one order after the other.

An estimate depends on its order and the data alone, so sharing the work changes no bit.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

from evopem.estimation.order_selection import Candidate, estimate_candidates
from evopem.models.armax import Orders
from evopem.signals.recording import Recording


def estimate_side_by_side(
    data: Recording,
    orders: Sequence[Orders],
    phase: str,
    search: Mapping[str, Any],
    scoring_start: int,
    log: Callable[[str], None] | None = None,
    cores: int = 1,
) -> list[Candidate]:
    """Estimate every order of a sweep, on several cores where there are some.

    Parameters
    ----------
    data, orders, phase, search, scoring_start, log
        As for `estimate_candidates`. On several cores what happens goes to the package's logger.
    cores : int
        Number of processes.

    Returns
    -------
    list
        What `estimate_candidates` returns, in the order of ``orders``.

    Raises
    ------
    InputError
        When the record is too short for an order.
    """
    if cores <= 1 or len(orders) <= 2:
        return estimate_candidates(data, orders, phase, search, scoring_start, log)
    # The largest go first, so that no core is left with one of them at the end. The smallest is
    # estimated here: it loads the compiled kernels, and a forked process has them from its start.
    smallest, *others = sorted(range(len(orders)), key=lambda index: orders[index].parameters)
    found = {
        smallest: estimate_candidates(data, [orders[smallest]], phase, search, scoring_start, log)
    }
    # Elsewhere than on Linux forking is unsafe.
    start = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    shared = (data, phase, dict(search), scoring_start)
    with ProcessPoolExecutor(min(cores, len(others)), start, _prepare, shared) as pool:
        running = {index: pool.submit(_estimate, orders[index]) for index in reversed(others)}
        found |= {index: estimate.result() for index, estimate in running.items()}
    return [candidate for index in range(len(orders)) for candidate in found[index]]


_task: dict[str, Any] = {}


def _prepare(data: Recording, phase: str, search: dict[str, Any], scoring_start: int) -> None:
    """Keep what all estimates of a process share, and end it when the one above it is gone."""
    _task.update(data=data, phase=phase, search=search, scoring_start=scoring_start)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _estimate(order: Orders) -> list[Candidate]:
    return estimate_candidates(orders=[order], log=logging.getLogger("evopem").info, **_task)
