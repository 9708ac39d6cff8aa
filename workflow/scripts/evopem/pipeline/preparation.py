"""Preparation: stationary, zero-mean samples, divided for estimation and validation."""

from __future__ import annotations

from evopem.config.order_grid import check_samples
from evopem.config.settings import (
    FitSettings,
    OrderGrid,
    PreparationSettings,
    SampleRequirements,
)
from evopem.pipeline.constraint_plan import check_fit
from evopem.results.layout import DatasetFiles
from evopem.signals.preparation import prepare, save_prepared
from evopem.signals.recording import load_recording
from evopem.signals.shared_samples import check_independent


def prepare_signals(
    files: DatasetFiles,
    settings: PreparationSettings,
    requirements: SampleRequirements,
    has_validation_recording: bool,
    fit: tuple[FitSettings, OrderGrid] | None = None,
) -> None:
    """Make both signals stationary, and divide them for estimation and validation.

    Raises
    ------
    InputError
        When a transform cannot be applied, too few samples are left for the order grid, the
        constraints contradict the sampling rate of the recording, or the validation recording
        shares its samples with the estimation recording.
    """
    place = f"datasets.{files.name}"
    recording = load_recording(files.recording)
    validation = load_recording(files.validation_recording) if has_validation_recording else None
    if validation is not None:
        check_independent(recording, validation, f"{place}.validation_file")
    prepared = prepare(recording, settings, validation, place)
    check_samples(requirements, prepared.estimation.samples, prepared.validation.samples, place)
    if fit is not None:
        check_fit(*fit, prepared.estimation.sampling_rate, place, "")
    save_prepared(prepared, files.prepared, files.transforms)
