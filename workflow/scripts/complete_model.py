"""Give the selected candidate its covariance, modes and responses."""

from typing import TYPE_CHECKING

from evopem.config.settings import FitSettings, ScoringWindow, SearchSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.model import complete_model
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    window = snakemake.params.window
    complete_model(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(SearchSettings, snakemake.params.search),
        from_json(ScoringWindow, window) if window else None,
        snakemake.params.phases,
        from_json(FitSettings, snakemake.params.fit),
    )
