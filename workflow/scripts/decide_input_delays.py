"""Decide the delay of each input."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.multichannel import decide_input_delays
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    decide_input_delays(DatasetFiles.of_log(snakemake.log[0]), snakemake.params.limits)
