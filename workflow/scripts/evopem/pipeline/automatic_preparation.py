"""Preparation by the automatic recipe: decided from the estimation samples alone, then applied."""

from __future__ import annotations

from threadpoolctl import threadpool_limits

from evopem.automatic.preparation import (
    GivenPreparation,
    PreparationPlan,
    PreparedRecord,
    prepare,
)
from evopem.automatic.preparation import decide_preparation as decide
from evopem.automatic.prepared_data import load_stretches, prepared_data, save_stretches
from evopem.config.settings import PreparationSettings
from evopem.errors import InputError
from evopem.files.json_form import load, save
from evopem.results.layout import DatasetFiles
from evopem.signals.joined_preparation import prepare_recordings
from evopem.signals.joining import separated
from evopem.signals.preparation import PreparedData, load_prepared, save_prepared
from evopem.signals.recording import load_recording
from evopem.signals.shared_samples import check_independent


def decide_preparation(
    files: DatasetFiles,
    settings: PreparationSettings,
    given: GivenPreparation,
    has_validation_recording: bool,
) -> None:
    """Decide how the recording is prepared, without a look at the validation samples.

    Raises
    ------
    InputError
        When the recording cannot be divided, or nothing can be identified from it.
    """
    divided = _divided(files, settings, has_validation_recording)
    try:
        with threadpool_limits(limits=1, user_api="blas"):
            plan = decide(separated(divided.estimation), given)
    except InputError as error:
        place = f"datasets.{files.name}"
        raise InputError(f"{place} ({error.source})", error.problem, error.remedy) from None
    save(plan, files.decision("preparation"))


def apply_preparation(
    files: DatasetFiles, settings: PreparationSettings, has_validation_recording: bool
) -> None:
    """Prepare both parts of the recording as it was decided.

    Raises
    ------
    InputError
        When too few validation samples are left.
    """
    divided = _divided(files, settings, has_validation_recording)
    plan = load(PreparationPlan, files.decision("preparation"))
    with threadpool_limits(limits=1, user_api="blas"):
        record = prepare(separated(divided.estimation), plan)
        prepared = prepared_data(divided, record, f"datasets.{files.name}")
    save_prepared(prepared, files.prepared, files.transforms)
    save_stretches(record.stretches, files.stretches)


def load_record(files: DatasetFiles) -> PreparedRecord:
    """All stretches of the estimation samples, with the plan behind them."""
    plan = load(PreparationPlan, files.decision("preparation"))
    rate = load_prepared(files.prepared, files.transforms).transforms.sampling_rate
    return PreparedRecord(load_stretches(files.stretches), rate, plan)


def _divided(
    files: DatasetFiles, settings: PreparationSettings, has_validation_recording: bool
) -> PreparedData:
    """Both parts of the recording, with the transforms that the configuration names."""
    place = f"datasets.{files.name}"
    recording = load_recording(files.recording)
    validation = load_recording(files.validation_recording) if has_validation_recording else None
    if validation is not None:
        check_independent(recording, validation, f"{place}.validation_file")
    return prepare_recordings(recording, settings, validation, place)
