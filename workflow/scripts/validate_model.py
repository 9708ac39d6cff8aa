"""Validate the model on samples that it was not estimated from."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.validation import validate_model
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    validate_model(DatasetFiles.of_log(snakemake.log[0]), snakemake.params.phase)
