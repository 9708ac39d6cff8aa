"""Choose a structure and orders for each purpose."""

from typing import TYPE_CHECKING

from evopem.config.settings import AutomaticSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.automatic_search import compare_structures
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    compare_structures(
        DatasetFiles.of_log(snakemake.log[0]),
        snakemake.params.structures,
        from_json(AutomaticSettings, snakemake.params.settings),
    )
