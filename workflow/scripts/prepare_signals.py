"""Make both signals stationary and divide them for estimation and validation."""

from typing import TYPE_CHECKING

from evopem.config.settings import (
    FitSettings,
    OrderGrid,
    PreparationSettings,
    SampleRequirements,
)
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.preparation import prepare_signals
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    prepare_signals(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(PreparationSettings, snakemake.params.preparation),
        from_json(SampleRequirements, snakemake.params.requirements),
        has_validation_recording=bool(snakemake.input.get("validation_recording")),
        fit=from_json(tuple[FitSettings, OrderGrid] | None, snakemake.params.fit),
        recorded=snakemake.params.recorded,
    )
