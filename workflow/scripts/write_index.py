"""List all data sets in one HTML file, with the orders, errors and checks of each."""

from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.console import job
from evopem.report.building import build_index
from evopem.writing import write_text

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(result_files: list[str], templates: Path, index_file: str) -> None:
    datasets: dict[str, dict[str, Path]] = defaultdict(dict)
    for file in map(Path, result_files):
        dataset, *name = file.relative_to(Path(index_file).parent).parts
        datasets[dataset]["/".join(name)] = file
    write_text(index_file, build_index(datasets, templates))


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        main(
            list(snakemake.input),
            Path(snakemake.scriptdir).parent / "templates",
            snakemake.output.index,
        )
