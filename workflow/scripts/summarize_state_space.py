"""Summarize a data set with several channels."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.multichannel.summary import summarize_state_space
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    summarize_state_space(DatasetFiles.of_log(snakemake.log[0]))
