"""The preparation of both parts of recordings, decided from the estimation samples alone."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from evopem.automatic.preparation.plan import PreparationPlan, decide_preparation, stretches_of
from evopem.automatic.preparation.transforms import TransformPlan, decide_transforms
from evopem.automatic.preparation.wrong_samples import decide_outliers
from evopem.config.settings import GivenPreparation, PreparationSettings
from evopem.signals.preparation import prepare
from evopem.signals.prepared_data import PreparedData
from evopem.signals.recording import Recording


def decide_parts(
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
    """The transforms of the estimation samples, judged in recorded units.

    A trend of one recording says nothing of others.
    """
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
