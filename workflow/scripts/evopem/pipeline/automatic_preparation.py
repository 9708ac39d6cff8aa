"""Preparation by the automatic recipe: decided from the estimation samples alone, then applied."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evopem.automatic.preparation import (
    GivenPreparation,
    PreparationPlan,
    PreparedRecord,
    prepare,
    stretches_as_recorded,
)
from evopem.automatic.preparation import decide_preparation as decide
from evopem.automatic.prepared_data import load_stretches, prepared_data, save_stretches
from evopem.automatic.transforms import TransformPlan, decide_transforms
from evopem.blas_threads import one_blas_thread
from evopem.config.settings import PreparationSettings
from evopem.errors import InputError
from evopem.files.json_form import load, save
from evopem.results.layout import DatasetFiles
from evopem.signals.joining import check_independent
from evopem.signals.preparation import PreparedData, load_prepared, save_prepared
from evopem.signals.preparation import prepare as divide
from evopem.signals.recording import Recording, load_recording

NO_TRANSFORMS = TransformPlan()


def decide_preparation(
    files: DatasetFiles,
    settings: PreparationSettings,
    given: GivenPreparation,
    is_validated: bool,
    recorded: tuple[str, ...] = (),
) -> None:
    """Decide how the recording is prepared, without a look at the validation samples.

    Parameters
    ----------
    files : DatasetFiles
    settings : PreparationSettings
    given : GivenPreparation
    is_validated : bool
    recorded : sequence of str
        The recorded files, those for validation last, for errors to name.

    Raises
    ------
    InputError
        When the recording cannot be divided, or nothing can be identified from it.
    """
    divided = _divided(files, settings, is_validated, recorded=recorded)
    try:
        with one_blas_thread():
            transforms = _decide_transforms(divided, given)
            if transforms.changes_samples:
                divided = _divided(files, settings, is_validated, transforms)
            if transforms.has_trend:
                given = replace(given, differences=0)  # a slope is no random walk
            plan = decide(divided.estimation.separated, given)
    except InputError as error:
        place = f"datasets.{files.name}"
        raise InputError(f"{place} ({error.source})", error.problem, error.remedy) from None
    decisions = (*plan.decisions, *transforms.decisions)
    plan = replace(plan, decisions=decisions, transforms=replace(transforms, decisions=()))
    save(plan, files.decision("preparation"))


def _decide_transforms(divided: PreparedData, given: GivenPreparation) -> TransformPlan:
    """The transforms of the estimation samples, judged in recorded units.

    A trend of one recording says nothing of others.
    """
    recordings = [
        each.with_signals(each.input + own.input_mean, each.output + own.output_mean)
        for each, own in zip(
            divided.estimation.separated,
            divided.transforms.of_stretches("estimation"),
            strict=True,
        )
    ]
    stretches, begins = stretches_as_recorded(recordings, given.start)
    return decide_transforms(
        stretches,
        begins,
        box_cox=given.box_cox,
        trend=given.differences is not None,
        continued=len(recordings) == 1 and divided.transforms.validation_source == "cut",
    )


def apply_preparation(
    files: DatasetFiles, settings: PreparationSettings, is_validated: bool
) -> None:
    """Prepare both parts of the recording as it was decided.

    Raises
    ------
    InputError
        When too few validation samples are left.
    """
    plan = load(PreparationPlan, files.decision("preparation"))
    divided = _divided(files, settings, is_validated, plan.transforms)
    with one_blas_thread():
        record = prepare(divided.estimation.separated, plan)
        prepared = prepared_data(divided, record, f"datasets.{files.name}")
    save_prepared(prepared, files.prepared, files.transforms)
    save_stretches(record.stretches, files.stretches)


def load_record(files: DatasetFiles) -> PreparedRecord:
    """All stretches of the estimation samples, with the plan behind them."""
    plan = load(PreparationPlan, files.decision("preparation"))
    rate = load_prepared(files.prepared, files.transforms).transforms.sampling_rate
    return PreparedRecord(load_stretches(files.stretches), rate, plan)


def _divided(
    files: DatasetFiles,
    settings: PreparationSettings,
    is_validated: bool,
    plan: TransformPlan = NO_TRANSFORMS,
    recorded: tuple[str, ...] = (),
) -> PreparedData:
    """Both parts of the recording, with the transforms of the configuration and of a plan."""
    place = f"datasets.{files.name}"
    recording = load_recording(files.recording)
    validation = load_recording(files.validation_recording) if is_validated else None
    if validation is not None:
        check_independent(recording, validation, f"{place}.validation_file")
    transforms = settings.transforms
    if plan.box_cox is not None:
        transforms = replace(transforms, box_cox=plan.box_cox)
    settings = replace(settings, transforms=transforms)
    if not plan.has_trend:
        return divide(recording, settings, validation, place, recorded)
    return _without_trend(recording, settings, plan, place)


def _without_trend(
    recording: Recording, settings: PreparationSettings, plan: TransformPlan, place: str
) -> PreparedData:
    """Both parts of one recording whose trends are taken away, from its first sample on."""
    rate = settings.resample or recording.sampling_rate
    slopes = plan.input_trend * rate, plan.output_trend * rate  # per second
    times = np.arange(recording.samples) / recording.sampling_rate
    # Where they are divided may depend on where the input rests, which a slope hides.
    own = divide(recording, settings, None, place).transforms.estimation_samples
    settings = replace(settings, split=replace(settings.split, estimation=own))
    level = recording.with_signals(
        recording.input - slopes[0] * times, recording.output - slopes[1] * times
    )
    divided = divide(level, settings, None, place)
    before = divided.transforms
    start = before.discard / before.sampling_rate
    transforms = replace(
        before,
        input_trend=slopes[0],
        output_trend=slopes[1],
        trend_start=start,
        validation_trend_start=start + before.estimation_samples / before.sampling_rate,
    )
    return replace(divided, transforms=transforms)
