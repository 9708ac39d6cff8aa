"""Preparation: stationary samples without means, divided for estimation and validation.

By the chapter's recipe it is given, by the automatic one decided from the estimation samples alone.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from evopem.arrays import one_blas_thread
from evopem.automatic.cross_validation.folds import decide_folds
from evopem.automatic.orders import decide_delays
from evopem.automatic.preparation.plan import (
    PreparationPlan,
    PreparedRecord,
    decide_preparation,
    prepared_data,
    stretches_of,
)
from evopem.automatic.preparation.transforms import TransformPlan, decide_transforms
from evopem.automatic.preparation.wrong_samples import decide_outliers
from evopem.config.order_grid import check_samples
from evopem.config.settings import (
    FitSettings,
    GivenPreparation,
    InputRanges,
    OrderGrid,
    PreparationSettings,
    SampleRequirements,
)
from evopem.errors import InputError
from evopem.files.json_form import save
from evopem.pipeline.planning.constraint_plan import check_fit, selectable_orders
from evopem.pipeline.structure_search import errors_name_dataset
from evopem.results.layout import DatasetFiles
from evopem.signals.preparation import prepare
from evopem.signals.prepared_data import PreparedData, save_prepared
from evopem.signals.recording import Recording, load_recording


def prepare_samples(
    files: DatasetFiles,
    settings: PreparationSettings,
    is_validated: bool,
    recorded: tuple[str, ...] = (),
    given: GivenPreparation | None = None,
    requirements: SampleRequirements | None = None,
    fit: tuple[FitSettings, OrderGrid] | None = None,
    delays: InputRanges = None,
) -> None:
    """Make all channels stationary, and divide the samples for estimation and validation.

    ``given`` is what the automatic recipe does not decide; None where all is given. Then the
    samples meet the ``requirements`` of the order grid, and the constraints of ``fit`` the sampling
    rate. The automatic recipe also decides how held-out samples are divided, and the delay of each
    input within ``delays``.
    """
    place = f"datasets.{files.name}"
    recording = load_recording(files.recording)
    validation = load_recording(files.validation_recording) if is_validated else None
    prepared = prepare(recording, settings, validation, place, recorded)
    if given is not None:
        with one_blas_thread():
            try:
                plan, prepared = _decided_parts(
                    prepared, (recording, validation), settings, given, recorded
                )
            except InputError as error:
                source = f"{place} ({error.source})"
                raise InputError(source, error.problem, error.remedy) from None
            prepared = prepared_data(prepared, plan, place)
        save(plan, files.decision("preparation"))
    if requirements is not None:
        _check_samples(requirements, prepared, place)
    if fit is not None:
        settings_of_fit, grid = fit
        rate = prepared.estimation.sampling_rate
        check_fit(settings_of_fit, selectable_orders(grid), rate, place, "")
    save_prepared(prepared, files.prepared, files.transforms)
    if given is not None:
        stretches = PreparedRecord.of(prepared.estimation, plan).stretches
        names = prepared.estimation.input_names
        with errors_name_dataset(files), one_blas_thread():
            delay = decide_delays(stretches, names, delays)
            save(delay, files.decision("delay"))
            save(decide_folds(stretches, max(delay.delays, default=0)), files.decision("folds"))


def _check_samples(requirements: SampleRequirements, prepared: PreparedData, place: str) -> None:
    """Refuse samples that are too few for some candidate; each stretch has states of its own."""
    estimation, validation = prepared.estimation, prepared.validation
    least = requirements.loss_start + requirements.settling
    lost = (len(estimation.segments) - 1) * least
    longest = max(segment.samples for segment in validation.segments)
    check_samples(requirements, estimation.samples - lost, longest, place)
    for segment in estimation.segments if estimation.is_joined else ():
        if segment.samples <= least:
            raise InputError(
                f"{place}.file",
                f"recording {segment.recording + 1} has {segment.samples} estimation samples, and"
                f" {least} of them settle its initial state",
                "leave it out, lower the upper ends of delay and orders, or record longer",
            )


def _decided_parts(
    divided: PreparedData,
    recordings: tuple[Recording, Recording | None],
    settings: PreparationSettings,
    given: GivenPreparation,
    recorded: Sequence[str],
) -> tuple[PreparationPlan, PreparedData]:
    """The plan of a preparation, and both parts with the transforms that were decided."""
    recording, validation, outliers = decide_outliers(*recordings, divided.transforms)
    if outliers.choice != "none":
        divided = prepare(recording, settings, validation)
    transforms = TransformPlan()
    if recording.has_input and recording.outputs.shape[1] == 1:  # whose simulations are scored
        transforms = _decide_transforms(divided, given)
    if transforms.box_cox is not None:
        bent = replace(settings.transforms, box_cox=transforms.box_cox)
        divided = prepare(recording, replace(settings, transforms=bent), validation)
    elif transforms.has_trend:
        divided = _without_trend(divided, recording, settings, transforms)
        given = replace(given, differences=0)  # a slope is no random walk
    plan = decide_preparation(divided.estimation, given, recorded)
    return replace(plan, decisions=(outliers, *plan.decisions, *transforms.decisions)), divided


def _decide_transforms(divided: PreparedData, given: GivenPreparation) -> TransformPlan:
    """The transforms of the estimation samples, judged in recorded units. A trend of one recording
    says nothing of others."""
    origins = divided.transforms.estimation
    recording = divided.estimation.with_segments(
        [
            replace(
                segment,
                inputs=segment.inputs + np.array(origin.input_means),
                outputs=segment.outputs + np.array(origin.output_means),
            )
            for segment, origin in zip(divided.estimation.segments, origins, strict=True)
        ]
    )
    as_recorded = GivenPreparation(given.start, 1, 0, "quadratic")
    stretches = stretches_of(recording, decide_preparation(recording, as_recorded))
    return decide_transforms(
        [stretch.segment for stretch in stretches],
        [recording.segments[stretch.place].first + stretch.begin for stretch in stretches],
        box_cox=given.box_cox,
        trend=given.differences is not None,
        continued=len(origins) == 1 and divided.transforms.validation_source == "cut",
    )


def _without_trend(
    divided: PreparedData, recording: Recording, settings: PreparationSettings, plan: TransformPlan
) -> PreparedData:
    """Both parts of one recording whose trends are taken away, from its first sample on."""
    rate = divided.transforms.sampling_rate
    inputs = plan.input_trends or (0.0,) * recording.inputs.shape[1]
    slopes = tuple(slope * rate for slope in inputs), (plan.output_trend * rate,)  # per second
    # Where they are divided may depend on where the input rests, which a slope hides.
    split = replace(settings.split, estimation=divided.transforms.estimation_samples)
    level = replace(
        recording,
        inputs=recording.inputs - np.outer(recording.times, slopes[0]),
        outputs=recording.outputs - np.outer(recording.times, slopes[1]),
    )
    prepared = prepare(level, replace(settings, split=split))
    transforms = replace(prepared.transforms, input_trends=slopes[0], output_trends=slopes[1])
    return replace(prepared, transforms=transforms)
