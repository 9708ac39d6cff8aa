"""Decide how a recording is prepared, from its estimation samples alone."""

from typing import TYPE_CHECKING

from evopem.automatic.preparation import GivenPreparation
from evopem.config.settings import PreparationSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.automatic_preparation import decide_preparation
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    decide_preparation(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(PreparationSettings, snakemake.params.preparation),
        from_json(GivenPreparation, snakemake.params.given),
        has_validation_recording=bool(snakemake.input.get("validation_recording")),
        recorded=snakemake.params.recorded,
    )
