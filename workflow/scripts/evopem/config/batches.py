"""Batches: the recordings that one job identifies, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Literal

from evopem.config.resources import recording_seconds
from evopem.config.settings import DatasetSettings, RunSettings
from evopem.errors import InputError

SECONDS_OF_A_BATCH = 120.0
"""Work of a job, by estimate, beside which the 2 s of its start are less than a fiftieth."""

LEAST_BATCHES = 16
"""So many batches, or one for each recording, keep the cores busy to the end of a run."""


MANY = 10
"""From so many data sets on, one job takes a recording through all stages where nothing is said."""


def with_jobs(run: RunSettings, datasets: int) -> RunSettings:
    """Decide how a run is divided into jobs where it says ``auto``.

    Each stage has a job of its own where there are few data sets, so that a change reruns only what
    depends on it. Of many, each has one job: there are fewer of them, and each ends with a report.
    """
    if run.one_job_per != "auto":
        return run
    whole = datasets >= MANY or run.recordings_per_job is not None
    return replace(run, one_job_per="recording" if whole else "stage")


def check_batches(run: RunSettings, source: str) -> None:
    """Refuse several recordings a job where the other keys leave no such job.

    Raises
    ------
    InputError
        Naming the key to change.
    """
    if run.recordings_per_job is None:
        return
    if run.one_job_per == "stage":
        raise InputError(
            source,
            "a job of several recordings runs all stages of each",
            "write one_job_per: recording, or remove the key",
            "recordings_per_job",
        )
    if run.report != "none":
        raise InputError(
            source,
            "a job of several recordings makes no reports",
            "write report: none, or remove the key",
            "recordings_per_job",
        )


def batches_of(
    datasets: Mapping[str, DatasetSettings],
    per_job: int | Literal["auto"] | None,
) -> dict[str, tuple[str, ...]]:
    """Divide data sets into batches of neighbours, numbered from 1; none for None.

    With ``"auto"`` a batch ends when its work takes :data:`SECONDS_OF_A_BATCH` by estimate, or
    when fewer than :data:`LEAST_BATCHES` would result from more recordings. Nothing of the
    computer counts, so that the batches are the same on every one.
    """
    if per_job is None:
        return {}
    names = list(datasets)
    if per_job == "auto":
        divided = list(_by_work(datasets))
    else:
        divided = [tuple(names[at : at + per_job]) for at in range(0, len(names), per_job)]
    return {str(number): batch for number, batch in enumerate(divided, start=1)}


def _by_work(
    datasets: Mapping[str, DatasetSettings],
) -> Iterator[tuple[str, ...]]:
    most = max(1, len(datasets) // LEAST_BATCHES)
    batch: list[str] = []
    seconds = 0.0
    for name, settings in datasets.items():
        batch.append(name)
        seconds += recording_seconds(settings)
        if seconds >= SECONDS_OF_A_BATCH or len(batch) >= most:
            yield tuple(batch)
            batch, seconds = [], 0.0
    if batch:
        yield tuple(batch)
