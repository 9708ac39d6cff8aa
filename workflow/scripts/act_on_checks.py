"""Apply remedies to the chosen model until its checks hold or nothing helps."""

from typing import TYPE_CHECKING

from evopem.config.settings import AutomaticSettings
from evopem.files.job import job
from evopem.files.json_form import from_json
from evopem.pipeline.automatic_search import act_on_checks
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    act_on_checks(
        DatasetFiles.of_log(snakemake.log[0]),
        from_json(AutomaticSettings, snakemake.params.settings),
    )
