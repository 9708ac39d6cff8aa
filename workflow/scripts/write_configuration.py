"""Keep the complete configuration of a data set beside its results."""

from typing import TYPE_CHECKING

from evopem.config.settings import DatasetSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.configuration import write_configuration
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    write_configuration(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(DatasetSettings, snakemake.params.settings),
    )
