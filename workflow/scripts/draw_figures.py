"""Draw every figure of one data set."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.figures import draw_figures
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    draw_figures(DatasetFiles.of_log(snakemake.log[0]))
