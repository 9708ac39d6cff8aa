"""Keep the complete configuration of a data set with several channels."""

from typing import TYPE_CHECKING

from evopem.config.state_space_settings import MultichannelDataset
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.multichannel.acquisition import write_multichannel_configuration
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    write_multichannel_configuration(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(MultichannelDataset, snakemake.params.settings),
    )
