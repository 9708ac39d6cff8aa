"""Preparation: stationary, zero-mean samples, divided for estimation and validation."""

from __future__ import annotations

from collections.abc import Sequence

from evopem.config.order_grid import check_samples
from evopem.config.settings import (
    FitSettings,
    OrderGrid,
    PreparationSettings,
    SampleRequirements,
)
from evopem.errors import InputError
from evopem.pipeline.constraint_plan import check_fit
from evopem.results.layout import DatasetFiles
from evopem.signals.joined_preparation import prepare_recordings
from evopem.signals.preparation import PreparedData, save_prepared
from evopem.signals.recording import load_recording
from evopem.signals.shared_samples import check_independent


def prepare_signals(
    files: DatasetFiles,
    settings: PreparationSettings,
    requirements: SampleRequirements,
    has_validation_recording: bool,
    fit: tuple[FitSettings, OrderGrid] | None = None,
    recorded: Sequence[str] = (),
) -> None:
    """Make both signals stationary, and divide them for estimation and validation.

    Parameters
    ----------
    files : DatasetFiles
    settings : PreparationSettings
    requirements : SampleRequirements
    has_validation_recording : bool
    fit : (FitSettings, OrderGrid), optional
        Whose constraints are checked with the sampling rate.
    recorded : sequence of str
        The recorded files, those for validation last, for errors to name.

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
    prepared = prepare_recordings(recording, settings, validation, place, recorded)
    _check_samples(requirements, prepared, place)
    if fit is not None:
        check_fit(*fit, prepared.estimation.sampling_rate, place, "")
    save_prepared(prepared, files.prepared, files.transforms)


def _check_samples(requirements: SampleRequirements, prepared: PreparedData, place: str) -> None:
    """Refuse samples that are too few for some candidate; each stretch has states of its own.

    Raises
    ------
    InputError
    """
    estimation, validation = prepared.estimation, prepared.validation
    lost = (len(estimation.stretches) - 1) * (requirements.loss_start + requirements.settling)
    longest = max(each.samples for each in validation.stretches)
    check_samples(requirements, estimation.samples - lost, longest, place)
    least = requirements.loss_start + requirements.settling
    for each in estimation.stretches if estimation.is_joined else ():
        if each.samples <= least:
            raise InputError(
                f"{place}.file",
                f"recording {each.recording + 1} has {each.samples} estimation samples, and"
                f" {least} of them settle its initial state",
                "leave it out, lower the upper ends of delay and orders, or record longer",
            )
