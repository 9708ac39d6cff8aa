"""Search the chosen structure and orders once more, globally."""

from typing import TYPE_CHECKING

from evopem.config.settings import SearchSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.automatic_model import estimate_chosen
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output) as logger:
    estimate_chosen(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(SearchSettings, snakemake.params.search),
        log=logger.info,
    )
