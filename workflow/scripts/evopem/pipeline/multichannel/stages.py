"""Every stage of a data set with several channels, in their order, in one process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from evopem.automatic.variant_search import Variant
from evopem.config.state_space_settings import MultichannelDataset, searched_variants
from evopem.pipeline.multichannel.acquisition import read_channels, write_multichannel_configuration
from evopem.pipeline.multichannel.choice import choose_state_space
from evopem.pipeline.multichannel.chosen import (
    complete_other_state_space,
    estimate_chosen_state_space,
)
from evopem.pipeline.multichannel.decisions import collect_state_space_decisions
from evopem.pipeline.multichannel.preparation import prepare_channels
from evopem.pipeline.multichannel.search import decide_input_delays, search_state_space, variants_of
from evopem.pipeline.multichannel.summary import summarize_state_space
from evopem.pipeline.multichannel.validation import validate_state_space
from evopem.pipeline.progress import Announce, Stage, run_stages
from evopem.results.layout import DatasetFiles

Log = Callable[[str], None]


def channel_stages(
    files: DatasetFiles,
    settings: MultichannelDataset,
    with_report: bool,
    log: Log | None = None,
) -> dict[str, Stage]:
    """List the stages of a data set by their names, in their order, ready to be called.

    Parameters are those of :func:`identify_channels`.
    """
    source, choices, search = settings.source, settings.choices, settings.search
    variants = variants_of(searched_variants(settings))
    given = (bool(settings.split.discard), settings.rate_given)
    read = partial(
        read_channels,
        channels=source.channels,
        geometry=settings.geometry,
        place=f"datasets.{files.name}",
    )
    listed: dict[str, Stage] = {
        "configuration": partial(write_multichannel_configuration, files, settings),
        "recording": partial(
            read, source.files, recording_file=files.recording, info_file=files.recording_info
        ),
    }
    if source.validation_files:
        listed["validation_recording"] = partial(
            read,
            source.validation_files,
            recording_file=files.validation_recording,
            info_file=files.validation_recording_info,
        )
    listed["preparation"] = partial(
        prepare_channels,
        *(files, source, settings.split, settings.resample, given),
    )
    listed["delays"] = partial(decide_input_delays, files, choices.orders.nk)
    for variant in variants:
        ranges = choices.orders.of_form(variant.form)
        listed[variant.name] = partial(search_state_space, files, variant, ranges, search, log)
    listed["structures"] = partial(choose_state_space, files, variants, choices)
    listed["chosen"] = partial(
        estimate_chosen_state_space,
        *(files, variants, choices.orders, search, settings.constraints, log),
    )
    if source.channels.inputs:
        listed["other_model"] = partial(
            complete_other_state_space, files, choices.orders, search, settings.constraints
        )
    listed["validation"] = partial(validate_state_space, files)
    listed["decisions"] = partial(collect_state_space_decisions, files)
    listed["summary"] = partial(summarize_state_space, files)
    if with_report:
        listed["report"] = partial(_write_report, files, settings, variants)
    return listed


def _write_report(
    files: DatasetFiles, settings: MultichannelDataset, variants: Sequence[Variant]
) -> None:
    # Figures take a while to import, and not every run draws them.
    from evopem.pipeline.multichannel.report import write_state_space_report

    write_state_space_report(files, settings, variants)


def identify_channels(
    files: DatasetFiles,
    settings: MultichannelDataset,
    with_report: bool,
    log: Log | None = None,
    announce: Announce | None = None,
) -> None:
    """Take one data set from its recording to its results.

    Parameters
    ----------
    files : DatasetFiles
    settings : MultichannelDataset
    with_report : bool
    log : callable, optional
        Receives progress in words.
    announce : callable, optional
        Receives each stage before it begins: its name, its number from 1, and how many there are.
    """
    run_stages(channel_stages(files, settings, with_report, log), announce)
