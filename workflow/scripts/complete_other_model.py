"""Complete the model for the other purpose of an automatic recipe."""

from typing import TYPE_CHECKING

from evopem.config.settings import SearchSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.automatic_model import complete_other_model
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    complete_other_model(
        DatasetFiles.of_log(snakemake.log[0]),
        snakemake.wildcards.purpose,
        from_json(SearchSettings, snakemake.params.search),
    )
