"""Simulate a recording of a known system."""

from typing import TYPE_CHECKING

from evopem.config.settings import SyntheticSource, TransformSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.synthesis import synthesize_recording
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    synthesize_recording(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(SyntheticSource, snakemake.params.source),
        from_json(TransformSettings, snakemake.params.transforms),
    )
