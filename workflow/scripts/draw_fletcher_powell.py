"""Draw every figure of the comparison on the Fletcher-Powell function."""

from pathlib import Path
from typing import TYPE_CHECKING

from evopem.figures.fletcher_powell import draw_comparison, read_comparison
from evopem.files.job import job

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(tables: list[str], figure_files: list[str]) -> None:
    draw_comparison(read_comparison(*map(Path, tables)), Path(figure_files[0]).parent)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(list(snakemake.input), list(snakemake.output))
