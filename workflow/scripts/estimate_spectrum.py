"""Estimate the multitaper spectrum of the prepared signals."""

from typing import TYPE_CHECKING

from evopem.config.settings import SpectrumSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.spectrum import estimate_spectrum
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    estimate_spectrum(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(SpectrumSettings, snakemake.params.spectrum),
    )
