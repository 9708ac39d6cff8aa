"""Decide how several channels are prepared, and prepare them."""

from typing import TYPE_CHECKING

from evopem.config.settings import SplitSettings
from evopem.config.state_space_settings import MultichannelSource
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.multichannel.preparation import prepare_channels
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    prepare_channels(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(MultichannelSource, snakemake.params.source),
        from_json(SplitSettings, snakemake.params.split),
        snakemake.params.resample,
        snakemake.params.given,
    )
