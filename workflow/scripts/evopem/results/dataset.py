"""All results of one data set, read once for figures and report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from evopem.automatic.candidates import Candidate as ScoredCandidate
from evopem.automatic.candidates import StructureSearch
from evopem.automatic.decision import DecisionRecord
from evopem.automatic.remedies import Remedied
from evopem.automatic.structures import Choice
from evopem.config.defaults import read_settings
from evopem.config.order_grid import phases_of_dataset
from evopem.config.settings import DatasetSettings
from evopem.config.structures import searched_forms
from evopem.errors import InputError
from evopem.estimation.candidate import Candidate, PhaseSelection
from evopem.estimation.model_record import ModelRecord, load_record
from evopem.files.json_form import load
from evopem.models.modes import Mode
from evopem.results.identity import check_results
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared
from evopem.signals.recording import Recording, load_recording
from evopem.signals.recording_info import FileOrigin, RecordingInfo
from evopem.signals.spectrum_summary import SpectrumSummary
from evopem.synthesis.armax import Truth
from evopem.validation.checks import Check, Evidence, OrderRange, checks
from evopem.validation.checks.search import ranges_of_phases
from evopem.validation.validation import Validation, ValidationTables


@dataclass(frozen=True, eq=False)
class DatasetResults:
    """The results of one data set, as typed objects and tables."""

    settings: DatasetSettings
    recording: Recording
    recording_info: RecordingInfo
    validation_recording_info: RecordingInfo | None
    prepared: PreparedData
    # candidates, frequency_response: as in the CSV files of these names
    candidates: pd.DataFrame
    frequency_response: pd.DataFrame
    model: ModelRecord
    validation: Validation
    validation_tables: ValidationTables
    truth: Truth | None
    decisions: DecisionRecord | None  # of the automatic recipe
    # spectrum, time_response: as in their CSV files, of one channel of each kind
    spectrum: pd.DataFrame
    time_response: pd.DataFrame
    spectrum_summaries: tuple[SpectrumSummary, ...]  # of each output
    # By the names of the phases of the order search, in their order
    phases: dict[str, PhaseSelection]
    searches: tuple[StructureSearch, ...] = ()  # of the automatic recipe, like the choice
    choice: Choice | None = None

    @property
    def name(self) -> str:
        """Name of the data set."""
        return self.settings.name

    @property
    def files(self) -> tuple[FileOrigin, ...]:
        """All recorded files, those for validation last."""
        validation = self.validation_recording_info
        return self.recording_info.files + (validation.files if validation else ())

    @property
    def evidence(self) -> Evidence:
        """What the checks of the model judge."""
        ranges = ranges_of_phases(self.phases)
        if self.choice is not None:
            ranges = searched_range(self.choice.candidate, self.searches)
        return Evidence(
            *(self.model, self.validation, self.recording_info, ranges),
            self.decisions is not None,
        )

    @property
    def checks(self) -> list[Check]:
        """The checks of the model."""
        return checks(self.evidence)


def searched_range(
    chosen: ScoredCandidate, searches: Sequence[StructureSearch]
) -> tuple[OrderRange, ...]:
    """The range of the orders of a structure that were searched; none where it came of a remedy.

    A range that nobody gives begins with 1 or 2.
    """
    tried = [each for s in searches if s.structure == chosen.structure for each in s.orders]
    if not tried:
        return ()
    name, key = "states of the plant", "orders.nx"
    if chosen.polynomials is not None:
        key = "orders.joint"
        name = "coefficients of B" if chosen.structure == "fir" else "largest degree of A and F"
    return (OrderRange(name, key, chosen.order, min(tried), max(tried), least=2),)


def read_whole_results(files: DatasetFiles) -> DatasetResults:
    """The results of one data set, read from outside their run: refused unless they are whole."""
    check_results(files)
    return read_results(files)


def read_results(files: DatasetFiles) -> DatasetResults:
    """The results of one data set; an `InputError` names a file that is missing or damaged."""
    settings = read_settings(files.config)

    def tables(*names: str) -> dict[str, pd.DataFrame]:
        return {name: read_table(getattr(files, name)) for name in names}

    is_automatic = settings.automatic is not None
    validation_info = files.validation_recording_info
    return DatasetResults(
        settings=settings,
        recording=load_recording(files.recording),
        recording_info=load(RecordingInfo, files.recording_info),
        validation_recording_info=load(RecordingInfo, validation_info)
        if Path(validation_info).exists()
        else None,
        prepared=load_prepared(files.prepared, files.transforms),
        model=load_record(files.model),
        validation=load(Validation, files.validation),
        validation_tables=ValidationTables(
            **tables("residual_autocorrelation", "cross_correlation", "simulation", "horizons")
        ),
        **tables("candidates", "frequency_response", "spectrum", "time_response"),
        truth=load(Truth, files.truth) if Path(files.truth).exists() else None,
        decisions=load(DecisionRecord, files.decisions) if is_automatic else None,
        spectrum_summaries=load(tuple[SpectrumSummary, ...], files.spectrum_summary),
        phases={phase: load(PhaseSelection, files.phase(phase)) for phase in phases_of_dataset(settings)},
        searches=tuple(load(StructureSearch, files.search(name)) for name in searched_forms(settings)),
        choice=load(Remedied, files.decision("remedies")).choice if is_automatic else None,
    )


def read_table(path: str) -> pd.DataFrame:
    """Read a CSV table of the results."""
    try:
        return pd.read_csv(path)
    except (OSError, ValueError):
        raise InputError(
            path,
            "is not a readable table",
            "delete the file and run snakemake again, which writes it anew",
        ) from None
