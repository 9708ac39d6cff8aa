"""Choose form, weighting and order."""

from typing import TYPE_CHECKING

from evopem.config.state_space_settings import StateSpaceChoices
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.multichannel.choice import choose_state_space
from evopem.pipeline.multichannel.search import variants_of
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    choose_state_space(
        DatasetFiles.of_log(snakemake.log[0]),
        variants_of(snakemake.params.variants),
        from_json(StateSpaceChoices, snakemake.params.choices),
    )
