"""Collect the candidates of one phase and select one of them."""

from typing import TYPE_CHECKING

from evopem.config.settings import OrderGrid, ScoringWindow, SearchSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.order_search import select_candidate
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output) as logger:
    select_candidate(
        DatasetFiles.of_log(snakemake.log[0]),
        snakemake.wildcards.phase,
        snakemake.params.parts,
        from_json(OrderGrid, snakemake.params.grid),
        from_json(SearchSettings, snakemake.params.search),
        from_json(ScoringWindow, snakemake.params.window),
        log=logger.info,
    )
