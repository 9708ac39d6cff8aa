"""A small data set, identified by the stages of the package, for the tests of their results.

:func:`identify` simulates an ARMAX recording and writes the files of its results. The fixture
``identified`` in ``conftest.py`` does so once a session.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

from evopem.config.defaults import complete
from evopem.config.settings import DatasetSettings
from evopem.config.structures import phases_of
from evopem.estimation.model_record import ModelRecord, derived_from
from evopem.files.atomic import files_below
from evopem.files.checksums import write_checksums
from evopem.models.modes import Mode
from evopem.models.polynomial import PolynomialModel
from evopem.pipeline.identification import jobs, remove_parts
from evopem.pipeline.report import report_page
from evopem.results.dataset import DatasetResults, read_results
from evopem.results.layout import FIGURES, DatasetFiles
from evopem.validation.validation import ValidationTables

PHASES = phases_of("armax")

# The true orders, ARMAX(7, 6, 7, 3), lie inside every range but that of the delay, which ends
# at 3: the check of the search ranges therefore fails.
WRITTEN = {
    "synthesis": "armax",
    "samples": 1500,
    "recipe": "chapter",
    "split": {"discard": 100, "estimation": 1000},
    "spectrum": {"nfft": 2048},
    "delay": {"orders": [6, 7], "nk": [2, 3]},
    "orders": {"plant": [6, 8], "nc": [5, 8], "nb": [5, 7]},
    "search": {"evaluations": 4000},
}
SETTINGS = complete({"datasets": {"bench": WRITTEN}}).datasets["bench"]
LEFT = ("report",)
"""Stages that are left to the tests."""


def identify(folder: Path, settings: DatasetSettings = SETTINGS) -> DatasetFiles:
    """Take a synthetic recording through the stages up to its summary."""
    files = DatasetFiles(str(folder))
    listed = [job for job in jobs(settings, files) if job.stage.name not in LEFT]
    for job in listed:
        job.run()
    remove_parts(listed)
    return files


def finish(files: DatasetFiles) -> None:
    """Write the checksums, as a run does at its end."""
    made = [file for file in files_below(files.folder, "") if "/logs/" not in file.as_posix()]
    write_checksums(made, files.folder, "identification")


def finished_copy(folder: Path, identified: Identified) -> DatasetFiles:
    """Copy an identified data set to a folder after whose name it is called, and finish it."""
    copytree(identified.files.folder, folder)
    config = folder / "config.yaml"
    config.write_text(config.read_text().replace("bench:", f"{folder.name}:"))
    files = DatasetFiles(str(folder))
    finish(files)
    return files


@contextmanager
def without_figures() -> Iterator[None]:
    """Write reports without their figures, which take longer to draw than all else."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("evopem.pipeline.report", "evopem.figures"):
            patch.setattr(f"{module}.svg_texts", lambda _: dict.fromkeys(FIGURES, "<svg/>"))
        yield


def undrawn_page(files: DatasetFiles) -> str:
    """The report without its figures, which take longer than all else."""
    return report_page(files, read_results(files), dict.fromkeys(FIGURES, "<svg/>"))


def with_model(record: ModelRecord, model: PolynomialModel) -> ModelRecord:
    """The record of another model, with all that follows from it."""
    return replace(
        record, structure=model.structure or model.orders.structure, **derived_from(model, 0)
    )


def with_outcome(results: DatasetResults, **parts: Any) -> DatasetResults:
    """The results with other numbers of the validation, or of its one output, input or pair."""
    validation = results.validation
    for name in ("outputs", "inputs", "pairs"):
        if name in parts:
            (one,) = getattr(validation, name)
            parts[name] = (replace(one, **parts[name]),)
    return replace(results, validation=replace(validation, **parts))


def with_output_name(results: DatasetResults, name: str, **changes: Any) -> DatasetResults:
    """The results as if the output had another name."""
    old = results.recording.output_names[0]
    tables = {
        field.name: renamed.assign(output=name) if "output" in renamed else renamed
        for field in fields(ValidationTables)
        if (
            renamed := getattr(results.validation_tables, field.name).rename(
                columns=lambda column: re.sub(f"_{old}$", lambda _: f"_{name}", column)
            )
        )
        is not None
    }
    recording = replace(results.recording, output_names=(name,), **changes)
    return replace(
        results,
        recording=recording,
        validation_tables=ValidationTables(**tables),
        frequency_response=results.frequency_response.assign(output=name),
    )


def with_judged_modes(results: DatasetResults, modes: Sequence[Mode]) -> DatasetResults:
    """The results as if the model had other modes, which nothing speaks against."""
    first = replace(results.validation.modes.modes[0], doubts=())
    judged = tuple(replace(first, mode=mode) for mode in modes)
    changed = with_outcome(results, modes=replace(results.validation.modes, modes=judged))
    return replace(changed, model=replace(results.model, modes=tuple(modes)))


def without_modes(results: DatasetResults) -> DatasetResults:
    """The results as if the model had no modes."""
    return with_outcome(results, modes=replace(results.validation.modes, modes=()))


def without_covariance(record: ModelRecord) -> ModelRecord:
    """The record of a model whose covariance is not known."""
    return replace(record, model=replace(record.model, covariance=None))


@dataclass(frozen=True)
class Identified:
    """The files of an identified data set and the results read from them."""

    files: DatasetFiles
    results: DatasetResults


def identify_once(shared: Path) -> Identified:
    """Identify the data set in a folder that worker processes share, unless another one has."""
    folder = shared / SETTINGS.name
    if not folder.exists():
        own = shared / f".{os.getpid()}"
        identify(own / SETTINGS.name)
        with suppress(OSError):  # another worker was first
            (own / SETTINGS.name).rename(folder)
    files = DatasetFiles(str(folder))
    return Identified(files, read_results(files))
