"""Decide the delay of each input."""

from typing import TYPE_CHECKING

from evopem.config.input_ranges import InputRanges
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.multichannel.search import decide_input_delays
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    ranges = from_json(InputRanges, snakemake.params.ranges)
    decide_input_delays(DatasetFiles.of_log(snakemake.log[0]), ranges)
