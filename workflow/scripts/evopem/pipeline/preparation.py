"""Preparation: stationary samples without means, divided for estimation and validation.

By the chapter's recipe it is given, by the automatic one decided from the estimation samples alone.
"""

from evopem.automatic.cross_validation.folds import decide_folds
from evopem.automatic.orders import decide_delays
from evopem.automatic.preparation.parts import decide_parts
from evopem.automatic.preparation.plan import PreparedRecord, prepared_data
from evopem.blas_threads import one_blas_thread
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
from evopem.signals.recording import load_recording


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
                plan, prepared = decide_parts(
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
            longest = max(delay.delays, default=0)
            save(decide_folds(stretches, longest), files.decision("folds"))


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
