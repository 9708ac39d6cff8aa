"""Start, rate and division of the samples of several channels."""

from __future__ import annotations

from dataclasses import replace

from evopem.automatic.multichannel_folds import describe_folds
from evopem.automatic.multichannel_preparation import (
    apply_multichannel_plan,
    decide_multichannel_preparation,
)
from evopem.blas_threads import one_blas_thread
from evopem.config.settings import RecordedSource, SplitSettings
from evopem.files.json_form import save
from evopem.results.layout import DatasetFiles
from evopem.signals.multichannel_preparation import divide_multichannel, save_multichannel_data
from evopem.signals.recording import load_recording


def prepare_channels(
    files: DatasetFiles,
    source: RecordedSource,
    split: SplitSettings,
    resample: float | None,
    given: tuple[bool, bool],
) -> None:
    """Decide start and decimation from the estimation samples alone, and prepare both parts.

    Parameters
    ----------
    files : DatasetFiles
    source : RecordedSource
    split : SplitSettings
    resample : float, optional
        New sampling rate in Hz.
    given : (bool, bool)
        Whether the configuration states the start, and the rate.

    Raises
    ------
    InputError
        When the recording cannot be divided.
    """
    recording = load_recording(files.recording)
    validation = None
    if source.validation_files:
        validation = load_recording(files.validation_recording)
    place = f"datasets.{files.name}"
    divided = divide_multichannel(recording, split, resample, validation, place, source.all_files)
    with one_blas_thread():
        plan = decide_multichannel_preparation(divided.estimation, *given)
        prepared = apply_multichannel_plan(divided, plan)
    plan = replace(plan, decisions=(*plan.decisions, describe_folds(prepared.estimation)))
    save(plan, files.decision("preparation"))
    save_multichannel_data(prepared, files.prepared, files.transforms)
