"""Preparation: stationary, zero-mean samples, divided for estimation and validation."""

from __future__ import annotations

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
from evopem.signals.joining import check_independent
from evopem.signals.preparation import PreparedData, prepare, save_prepared
from evopem.signals.recording import load_recording


def prepare_signals(
    files: DatasetFiles,
    settings: PreparationSettings,
    requirements: SampleRequirements,
    is_validated: bool,
    fit: tuple[FitSettings, OrderGrid] | None = None,
    recorded: tuple[str, ...] = (),
) -> None:
    """Make both signals stationary, and divide them for estimation and validation.

    Parameters
    ----------
    files : DatasetFiles
    settings : PreparationSettings
    requirements : SampleRequirements
    is_validated : bool
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
    validation = load_recording(files.validation_recording) if is_validated else None
    if validation is not None:
        check_independent(recording, validation, f"{place}.validation_file")
    prepared = prepare(recording, settings, validation, place, recorded)
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
    lost = (len(estimation.segments) - 1) * (requirements.loss_start + requirements.settling)
    longest = max(each.samples for each in validation.segments)
    check_samples(requirements, estimation.samples - lost, longest, place)
    least = requirements.loss_start + requirements.settling
    for each in estimation.segments if estimation.is_joined else ():
        if each.samples <= least:
            raise InputError(
                f"{place}.file",
                f"recording {each.recording + 1} has {each.samples} estimation samples, and"
                f" {least} of them settle its initial state",
                "leave it out, lower the upper ends of delay and orders, or record longer",
            )
