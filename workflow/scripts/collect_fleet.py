"""Collect all data sets: one page that lists them, and one table of all modes and checks."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.files.atomic import write_parquet, write_table, write_text
from evopem.files.job import job
from evopem.report.page import build_index
from evopem.results.fleet import fleet_table, read_summaries

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(names: Sequence[str], templates: Path, page: str, outputs: Sequence[str]) -> None:
    index_file, csv_file, parquet_file = outputs
    summaries = read_summaries(Path(index_file).parent, names)
    write_text(index_file, build_index(summaries, templates, page))
    table = fleet_table(summaries)
    write_table(csv_file, table)
    write_parquet(parquet_file, table)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            [Path(file).parent.name for file in snakemake.input],
            Path(snakemake.scriptdir).parent / "templates",
            snakemake.params.page,
            snakemake.output,
        )
