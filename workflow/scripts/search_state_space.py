"""Estimate all orders of a form, and score them on held-out samples."""

from typing import TYPE_CHECKING

from evopem.config.state_space_settings import OrderRanges, StateSpaceSearchSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.multichannel.search import search_state_space, variant_named
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output) as logger:
    search_state_space(
        DatasetFiles.of_log(snakemake.log[0]),
        variant_named(snakemake.wildcards.variant),
        from_json(OrderRanges, snakemake.params.ranges),
        from_json(StateSpaceSearchSettings, snakemake.params.search),
        logger.info,
    )
