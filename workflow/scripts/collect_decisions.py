"""Put all decisions of a data set into one file."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.automatic_model import collect_decisions
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    collect_decisions(
        DatasetFiles.of_log(snakemake.log[0]), snakemake.params.structures, snakemake.params.other
    )
