"""Draw every figure of the comparison."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import product_path  # noqa: F401
from evopem.files.job import job
from fletcher_powell.figures import draw_figures
from fletcher_powell.tables import read_tables

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(table_files: Sequence[str], figure_files: Sequence[str]) -> None:
    draw_figures(read_tables(*table_files), Path(figure_files[0]).parent)


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(list(snakemake.input), list(snakemake.output))
