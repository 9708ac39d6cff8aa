"""Decide how held-out samples are divided."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.automatic_search import decide_folds
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    decide_folds(DatasetFiles.of_log(snakemake.log[0]))
