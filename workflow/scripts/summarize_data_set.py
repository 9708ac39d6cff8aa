"""Summarize one data set: its modes, errors and checks in one small file."""

from pathlib import Path
from typing import TYPE_CHECKING

from evopem.files.atomic import write_json
from evopem.files.job import job
from evopem.results.fleet import summarize

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(result_files: list[str], summary_file: str) -> None:
    write_json(summary_file, summarize({Path(file).name: Path(file) for file in result_files}))


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(list(snakemake.input), snakemake.output.summary)
