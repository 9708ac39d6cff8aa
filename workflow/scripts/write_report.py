"""Write the report of one data set."""

from typing import TYPE_CHECKING

from evopem.files.job import job
from evopem.pipeline.report import write_report
from evopem.report.templates import template_folder
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with job(snakemake.log[0], snakemake.input, snakemake.output):
    write_report(DatasetFiles.of_log(snakemake.log[0]), template_folder())
