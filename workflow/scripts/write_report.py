"""Set the results and figures of one data set into one HTML file."""

from pathlib import Path
from typing import TYPE_CHECKING

from evopem.console import job
from evopem.report.building import build_report
from evopem.writing import write_text

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(result_files: list[str], templates: Path, dataset: str, report_file: str) -> None:
    directory = Path(report_file).parent
    results = {Path(file).relative_to(directory).as_posix(): Path(file) for file in result_files}
    write_text(report_file, build_report(results, templates, dataset))


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            list(snakemake.input),
            Path(snakemake.scriptdir).parent / "templates",
            snakemake.wildcards.dataset,
            snakemake.output.report,
        )
