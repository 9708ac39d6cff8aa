"""Summarize one data set: its orders, modes, errors and checks."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.summary import summarize_dataset
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    summarize_dataset(DatasetFiles.of_log(snakemake.log[0]), snakemake.params.phases)
