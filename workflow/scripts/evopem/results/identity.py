"""Whether the results of a data set are whole: finished, and as their jobs wrote them.

Everything that reads results from outside their run asks here: ``read_results``, ``compare``,
the lists of all data sets and Snakemake's report. Nothing here imports numpy or pandas: a
Snakefile uses this module.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from evopem.errors import InputError
from evopem.files.checksums import checksummed, sha256_of_file
from evopem.files.unfinished import unfinished_jobs
from evopem.results.layout import DatasetFiles


@dataclass(frozen=True)
class IncompleteDataset:
    """A data set whose results are not complete."""

    # ``unfinished`` where the run ended before its jobs, or a job of it could not start
    status: Literal["failed", "unfinished"]
    problem: str  # what is wrong, in a sentence
    # The log that says more, relative to the data set's folder; empty where there is none
    log: str = ""


def check_results(files: DatasetFiles) -> None:
    """Refuse results that no run has finished, or that were changed afterwards.

    Raises InputError naming the folder and what is wrong.
    """
    fault = incompleteness(files)
    if fault is not None:
        problem, _, remedy = fault.problem.removesuffix(".").rpartition("; ")
        raise InputError(files.folder, f"its results are not whole: {problem or remedy}", remedy)


def incompleteness(
    files: DatasetFiles, required: Collection[str] = (), pending: bool = False
) -> IncompleteDataset | None:
    """Why the results of a data set are not whole; None where they are.

    They are whole if no job is left or unfinished, every required file exists, every file is as its
    job wrote it, and the summary was made from the present model, validation and recording.

    ``required``: beside model, validation and summary.  ``pending``: whether the run has ended with
    jobs of this data set left.
    """
    needed = (*required, files.model, files.validation, files.summary)
    missing = next((file for file in needed if not Path(file).exists()), None)
    jobs = unfinished_jobs(files.logs, Path(files.summary).name)
    if jobs:
        log = Path(files.log(jobs[0].job))
        shown = log.relative_to(files.folder).as_posix() if log.is_file() else ""
        return IncompleteDataset("failed", jobs[0].sentence, shown)
    if pending or missing:
        what = f"{missing} has not been made" if missing else "not all of its jobs have run"
        return IncompleteDataset("unfinished", f"{what}; run snakemake again.")
    return _damage(files)


def _damage(files: DatasetFiles) -> IncompleteDataset | None:
    """The first file that is not as its job wrote it; None where there is none."""
    known = checksummed(files.folder)
    for file in (files.model, files.validation, files.summary):
        if Path(file) not in known:
            return _changed(file, "has no checksum, which a finished run has written")
    for path, checksum in known.items():
        if path.is_file() and sha256_of_file(path) != checksum:
            return _changed(path, "was changed or damaged after it was written")
    for name, checksum in _sources_of(files.summary).items():
        path = Path(files.folder) / name
        if not path.is_file() or sha256_of_file(path) != checksum:
            return _changed(files.summary, f"was not made from the present {name}")
    return None


def _changed(file: str | Path, problem: str) -> IncompleteDataset:
    return IncompleteDataset("failed", f"{file}: {problem}; delete it and run snakemake again.")


def _sources_of(summary: str) -> Mapping[str, str]:
    try:
        return dict(json.loads(Path(summary).read_text(encoding="utf-8"))["made_from"])
    except (OSError, ValueError, KeyError, TypeError):
        return {}
