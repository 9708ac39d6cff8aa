"""Search the orders of one structure."""

from typing import TYPE_CHECKING

from evopem.config.settings import AutomaticSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.automatic_search import search_structure
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    search_structure(
        DatasetFiles.of_log(snakemake.log[0]),
        snakemake.wildcards.structure,
        from_json(AutomaticSettings, snakemake.params.limits),
    )
