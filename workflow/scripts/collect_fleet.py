"""List all data sets in one page, and their modes and checks in one table."""

from pathlib import Path
from typing import TYPE_CHECKING

from evopem.config.conditions import positions
from evopem.files.job import job
from evopem.pipeline.fleet import collect_fleet
from evopem.report.templates import template_folder
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

names, results = snakemake.params.names, Path(snakemake.output.index).parent
summaries = [DatasetFiles(f"{results}/{name}").summary for name in names]
with job(snakemake.log[0], summaries, snakemake.output):
    collect_fleet(
        names,
        template_folder(),
        snakemake.params.page,
        snakemake.output.index,
        snakemake.output.csv,
        snakemake.output.parquet,
        snakemake.output.modes,
        positions(snakemake.params.order),
    )
