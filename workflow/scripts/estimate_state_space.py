"""Search the chosen model globally, and write what follows from it."""

from typing import TYPE_CHECKING

from evopem.config.constraints import InputConstraints
from evopem.config.state_space_settings import OrderRanges, StateSpaceSearchSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.multichannel.chosen import estimate_chosen_state_space
from evopem.pipeline.multichannel.search import variants_of
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output) as logger:
    constraints = snakemake.params.constraints
    estimate_chosen_state_space(
        DatasetFiles.of_log(snakemake.log[0]),
        variants_of(snakemake.params.variants),
        from_json(OrderRanges, snakemake.params.ranges),
        from_json(StateSpaceSearchSettings, snakemake.params.search),
        from_json(InputConstraints, constraints) if constraints else None,
        logger.info,
    )
