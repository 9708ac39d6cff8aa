"""Take one recording of several channels through all stages in one process."""

from typing import TYPE_CHECKING

from evopem.config.state_space_settings import MultichannelDataset
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.multichannel.stages import identify_channels
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output) as logger:
    identify_channels(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(MultichannelDataset, snakemake.params.settings),
        with_report=snakemake.params.with_report,
        log=logger.info,
    )
