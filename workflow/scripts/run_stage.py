"""Run one stage, or all stages of a data set: the function that a rule names."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.call import call
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output) as logger:
    call(
        snakemake.params.function,
        DatasetFiles.of_log(snakemake.log[0]),
        snakemake.params.arguments,
        dict(snakemake.wildcards.items()),
        logger.info,
        snakemake.threads,
    )
