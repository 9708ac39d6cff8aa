"""List every candidate of every phase in one table."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.candidates import tabulate_candidates
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    tabulate_candidates(DatasetFiles.of_log(snakemake.log[0]), snakemake.params.phases)
