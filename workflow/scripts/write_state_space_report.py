"""Set the results of a data set with several channels into one HTML file."""

from typing import TYPE_CHECKING

from evopem.config.state_space_settings import MultichannelDataset
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.multichannel.report import write_state_space_report
from evopem.pipeline.multichannel.search import variants_of
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    write_state_space_report(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(MultichannelDataset, snakemake.params.settings),
        variants_of(snakemake.params.variants),
    )
