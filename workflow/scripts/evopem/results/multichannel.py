"""All results of one data set with several channels, read once, and its summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from evopem.automatic.candidates import StructureSearch
from evopem.automatic.record import DecisionRecord
from evopem.automatic.remedies import Remedied
from evopem.automatic.structures import Choice
from evopem.config.settings import DatasetSettings
from evopem.estimation.model_record import ModelRecord
from evopem.files.checksums import sha256_of_file
from evopem.files.json_form import load
from evopem.models.modes import Mode
from evopem.models.modes import Mode
from evopem.models.state_space_tables import gain_intervals
from evopem.results.dataset import read_table
from evopem.results.fleet import GAIN_BANDS, DatasetSummary
from evopem.results.layout import DatasetFiles
from evopem.signals.recording import Recording
from evopem.signals.prepared_data import PreparedData, load_prepared
from evopem.signals.recording_info import FileOrigin, RecordingInfo
from evopem.signals.spectral.frequency_response import frequency_response
from evopem.validation.checks import Check
from evopem.validation.checks.state_space import state_space_checks
from evopem.validation.modes_record import ModesRecord
from evopem.validation.multichannel import MultichannelValidation

NFFT = 1024


@dataclass(frozen=True, eq=False)
class MultichannelResults:
    """The results of one data set with several channels, as typed objects and tables.

    Attributes
    ----------
    settings : DatasetSettings
    config_text : str
        The complete configuration.
    recording_info : RecordingInfo
    validation_recording_info : RecordingInfo, optional
        Of files for validation.
    prepared : PreparedData
    model : ModelRecord
    modes : ModesRecord
    frequency_response, simulation, residual_autocorrelation, cross_correlation : pandas.DataFrame
        As in ``frequency_response.csv`` and the other files of these names.
    validation : MultichannelValidation
    searches : tuple of StructureSearch
    choice : Choice
    decisions : DecisionRecord
    """

    settings: DatasetSettings
    config_text: str
    recording_info: RecordingInfo
    validation_recording_info: RecordingInfo | None
    prepared: PreparedData
    model: ModelRecord
    modes: ModesRecord
    frequency_response: pd.DataFrame
    simulation: pd.DataFrame
    residual_autocorrelation: pd.DataFrame
    cross_correlation: pd.DataFrame
    validation: MultichannelValidation
    searches: tuple[StructureSearch, ...]
    choice: Choice
    decisions: DecisionRecord

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
    def checks(self) -> list[Check]:
        """The checks of the model."""
        return state_space_checks(
            self.model, self.validation, self.choice.candidate.order, self.tried, self.recording_info
        )

    @property
    def tried(self) -> tuple[int, ...]:
        """The orders of the chosen structure that were searched."""
        structure = self.choice.candidate.structure
        return next(each.orders for each in self.searches if each.structure == structure)

    @property
    def trusted_modes(self) -> list[Mode]:
        """The modes that give no reason to doubt them."""
        return list(self.modes.table.trusted)


def read_multichannel_results(
    files: DatasetFiles, settings: DatasetSettings, structures: Sequence[str]
) -> MultichannelResults:
    """Read the results of one data set with several channels.

    Parameters
    ----------
    files : DatasetFiles
    settings : DatasetSettings
    structures : sequence of str
        That were searched.

    Raises
    ------
    InputError
        When a file is missing or damaged.
    """
    return MultichannelResults(
        settings=settings,
        config_text=Path(files.config).read_text(encoding="utf-8"),
        recording_info=load(RecordingInfo, files.recording_info),
        validation_recording_info=load(RecordingInfo, files.validation_recording_info)
        if settings.source.validation_files
        else None,
        prepared=load_prepared(files.prepared, files.transforms),
        model=load(ModelRecord, files.model),
        modes=load(ModesRecord, files.modes_json),
        frequency_response=read_table(files.frequency_response),
        simulation=read_table(files.simulation),
        residual_autocorrelation=read_table(files.residual_autocorrelation),
        cross_correlation=read_table(files.cross_correlation),
        validation=load(MultichannelValidation, files.validation),
        searches=tuple(load(StructureSearch, files.search(name)) for name in structures),
        choice=load(Remedied, files.decision("remedies")).choice,
        decisions=load(DecisionRecord, files.decisions),
    )


def summarize_multichannel(files: DatasetFiles) -> DatasetSummary:
    """Summarize one data set with several channels."""
    record = load(ModelRecord, files.model)
    validation = load(MultichannelValidation, files.validation)
    info = load(RecordingInfo, files.recording_info)
    modes = load(ModesRecord, files.modes_json)
    chosen = load(Remedied, files.decision("remedies")).choice.candidate
    tried = load(StructureSearch, files.search(chosen.structure)).orders
    return DatasetSummary(
        file=info.files[0].path,
        sha256=info.files[0].sha256,
        sampling_rate=record.sampling_rate,
        estimation_samples=record.transforms.estimation_samples,
        validation_samples=record.transforms.validation_samples,
        orders=None,
        multichannel_model=record.text,
        bic=record.bic,
        prediction_error_percent=validation.prediction_error_percent,
        simulation_error_percent=validation.simulation_error_percent,
        fitted_state_error_percent=validation.fitted_state_error_percent,
        checks=tuple(state_space_checks(record, validation, chosen.order, tried, info)),
        modes=modes.modes,
        trusted=modes.trusted,
        shapes=tuple(tuple(map(complex, mode.shape)) for mode in modes.modes),
        gain_db=_gain_outline(record),
        made_from={
            Path(file).name: sha256_of_file(file)
            for file in (files.recording_info, files.model, files.validation)
        },
    )


def frequency_response_rows(
    record: ModelRecord, estimation: Recording
) -> dict[str, list[Any]]:
    """Gains and phases of every pair of output and input, the model's and the measured ones.

    One row for each frequency of each pair; without an input none.

    Parameters
    ----------
    record : ModelRecord
    estimation : Recording
        Samples behind the measured response.
    """
    names = (
        *("frequency_hz", "output", "input", "gain", "gain_lower", "gain_upper", "phase_deg"),
        *("measured_gain", "measured_phase_deg", "coherence"),
    )
    rows: dict[str, list[Any]] = {name: [] for name in names}
    if not estimation.has_input:
        return rows
    plant = record.plant
    # Enough tapers for the spectral matrix of the inputs to be inverted.
    width = max(4.0, 2.0 * len(record.input_names) + 1.0)
    measured = frequency_response(estimation, min(width, estimation.longest.samples / 4.0), NFFT)
    response = plant.frequency_response(measured.frequencies)
    lower, upper = gain_intervals(plant, measured.frequencies)
    phase = np.degrees(np.unwrap(np.angle(response), axis=0))
    count = len(measured.frequencies)
    for row, output in enumerate(record.output_names):
        for column, input_ in enumerate(record.input_names):
            own = measured.response[:, row, column]
            rows["output"] += [output] * count
            rows["input"] += [input_] * count
            for name, values in (
                ("frequency_hz", measured.frequencies),
                ("gain", np.abs(response[:, row, column])),
                ("gain_lower", lower[:, row, column]),
                ("gain_upper", upper[:, row, column]),
                ("phase_deg", phase[:, row, column]),
                ("measured_gain", np.abs(own)),
                ("measured_phase_deg", np.degrees(np.angle(own))),
                ("coherence", measured.coherence[:, row]),
            ):
                rows[name] += values.tolist()
    return rows


def _gain_outline(record: ModelRecord) -> tuple[float, ...]:
    """The largest singular value of each band, in decibels to one decimal."""
    bands = np.linspace(0.0, record.sampling_rate / 2, 8 * GAIN_BANDS + 1)[1:]
    model = record.plant if record.input_names else record.state_space
    response = (
        model.frequency_response(bands) if record.input_names else model.noise_response(bands)
    )
    largest = np.linalg.svd(response, compute_uv=False)[:, 0]
    with np.errstate(divide="ignore"):
        outline = 20.0 * np.log10(largest.reshape(GAIN_BANDS, -1).max(axis=1))
    return tuple(np.round(outline, 1).tolist())
