"""Put all decisions of a data set with several channels into one file."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.multichannel.decisions import collect_state_space_decisions
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    collect_state_space_decisions(DatasetFiles.of_log(snakemake.log[0]))
