"""Draw every figure of one data set from its results."""

from pathlib import Path
from typing import TYPE_CHECKING

from evopem.figures import draw_all
from evopem.files.job import job

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(result_files: list[str], figure_files: list[str]) -> None:
    directory = Path(figure_files[0]).parent
    results = {
        Path(file).relative_to(directory.parent).as_posix(): Path(file) for file in result_files
    }
    draw_all(results, directory)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(list(snakemake.input), list(snakemake.output))
