"""Validate a state-space model on samples that no choice has seen."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.multichannel.validation import validate_state_space
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    validate_state_space(DatasetFiles.of_log(snakemake.log[0]))
