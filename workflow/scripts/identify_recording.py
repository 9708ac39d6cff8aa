"""Take one recording through all stages in one process."""

from typing import TYPE_CHECKING

from evopem.config.settings import DatasetSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.identification import identify_recording
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output) as logger:
    identify_recording(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(DatasetSettings, snakemake.params.settings),
        with_report=snakemake.params.with_report,
        log=logger.info,
        cores=snakemake.threads,
    )
