"""All results of one data set, read once for figures and report."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from evopem.automatic.record import DecisionRecord
from evopem.config.order_grid import phase_of_orders_of, phases_of_dataset
from evopem.config.settings import DatasetSettings
from evopem.errors import InputError
from evopem.estimation.candidate import Candidate, PhaseSelection
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import PreparedData, load_prepared
from evopem.signals.recording import Recording, load_recording
from evopem.signals.recording_info import RecordingInfo
from evopem.signals.spectral.summary import SpectrumSummary
from evopem.synthesis.truth import Truth
from evopem.validation.checks import Check, checks
from evopem.validation.mode_evidence import ModeEvidence
from evopem.validation.mode_trust import doubts
from evopem.validation.validation import Validation, ValidationTables


@dataclass(frozen=True, eq=False)
class DatasetResults:
    """The results of one data set, as typed objects and tables.

    Attributes
    ----------
    settings : DatasetSettings
    recording : Recording
    recording_info : RecordingInfo
    validation_recording_info : RecordingInfo, optional
    prepared : PreparedData
    spectrum : pandas.DataFrame
        As in ``spectrum.csv``.
    spectrum_summary : SpectrumSummary
    phases : dict of str to PhaseSelection
        By the names of the phases of the structure, in their order.
    candidates : pandas.DataFrame
        As in ``candidates.csv``.
    model : ModelRecord
    frequency_response : pandas.DataFrame
        As in ``frequency_response.csv``.
    time_response : pandas.DataFrame
        As in ``time_response.csv``.
    validation : Validation
    validation_tables : ValidationTables
    truth : Truth, optional
    decisions : DecisionRecord, optional
        Of the automatic recipe.
    """

    settings: DatasetSettings
    recording: Recording
    recording_info: RecordingInfo
    validation_recording_info: RecordingInfo | None
    prepared: PreparedData
    spectrum: pd.DataFrame
    spectrum_summary: SpectrumSummary
    phases: dict[str, PhaseSelection]
    candidates: pd.DataFrame
    model: ModelRecord
    frequency_response: pd.DataFrame
    time_response: pd.DataFrame
    validation: Validation
    validation_tables: ValidationTables
    truth: Truth | None
    decisions: DecisionRecord | None = None

    @property
    def name(self) -> str:
        """Name of the data set."""
        return self.settings.name

    @property
    def selected(self) -> Candidate:
        """The candidate that became the model."""
        return self.phases[list(self.phases)[-1]].selected

    @property
    def models_of_orders(self) -> PhaseSelection:
        """The models over which the modes are compared, and the selected one."""
        phase = self.phases[phase_of_orders_of(self.settings)]
        return replace(phase, candidates=phase.over_orders(self.model.structure))

    @property
    def checks(self) -> list[Check]:
        """The checks of the model."""
        return checks(
            self.model,
            self.validation,
            self.spectrum_summary,
            self.phases,
            self.recording_info,
        )

    @property
    def trusted_modes(self) -> list[ModeEvidence]:
        """The modes that the data give no reason to doubt."""
        rate = self.model.sampling_rate
        return [each for each in self.validation.modes if not doubts(each, rate)]


def read_dataset_results(files: DatasetFiles, settings: DatasetSettings) -> DatasetResults:
    """Read the results of one data set.

    Raises
    ------
    InputError
        When a file is missing or damaged.
    """

    def optional_info(path: str) -> RecordingInfo | None:
        return load(RecordingInfo, path) if Path(path).exists() else None

    phases = phases_of_dataset(settings)
    return DatasetResults(
        settings=settings,
        recording=load_recording(files.recording),
        recording_info=load(RecordingInfo, files.recording_info),
        validation_recording_info=optional_info(files.validation_recording_info),
        prepared=load_prepared(files.prepared, files.transforms),
        spectrum=read_table(files.spectrum),
        spectrum_summary=load(SpectrumSummary, files.spectrum_summary),
        phases={phase: load(PhaseSelection, files.phase(phase)) for phase in phases},
        candidates=read_table(files.candidates),
        model=load(ModelRecord, files.model),
        frequency_response=read_table(files.frequency_response),
        time_response=read_table(files.time_response),
        validation=load(Validation, files.validation),
        validation_tables=ValidationTables(
            residual_autocorrelation=read_table(files.residual_autocorrelation),
            cross_correlation=read_table(files.cross_correlation),
            simulation=read_table(files.simulation),
            horizons=read_table(files.horizons),
        ),
        truth=load(Truth, files.truth) if Path(files.truth).exists() else None,
        decisions=None if settings.automatic is None else load(DecisionRecord, files.decisions),
    )


def read_table(path: str) -> pd.DataFrame:
    """Read a CSV table of the results.

    Raises
    ------
    InputError
        When the file is missing or not a table.
    """
    try:
        return pd.read_csv(path)
    except (OSError, ValueError):
        raise InputError(
            path,
            "is not a readable table",
            "delete the file and run snakemake again, which writes it anew",
        ) from None
