"""Decide the delay from which structures are searched."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.automatic_search import decide_delay
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    limits = snakemake.params.limits["nk"]
    decide_delay(DatasetFiles.of_log(snakemake.log[0]), tuple(limits) if limits else None)
