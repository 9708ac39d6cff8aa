"""Set the comparison on the Fletcher-Powell function into one HTML file, and its tables as text."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evopem.figures.fletcher_powell import read_comparison
from evopem.files.atomic import write_text
from evopem.files.job import job
from evopem.report.fletcher_powell import build_comparison, comparison_markdown

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(
    tables: list[str],
    claims_file: str,
    figure_files: list[str],
    settings: dict[str, Any],
    templates: Path,
    outputs: dict[str, str],
) -> None:
    results = read_comparison(*map(Path, tables))
    claims = json.loads(Path(claims_file).read_text(encoding="utf-8"))
    figures = {Path(file).stem: Path(file).read_text(encoding="utf-8") for file in figure_files}
    write_text(outputs["report"], build_comparison(results, claims, figures, settings, templates))
    write_text(outputs["text"], comparison_markdown(results.summary, claims, settings))


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        given = snakemake.input
        main(
            [given.table, given.runs, given.convergence, given.landscape, given.minima],
            given.claims,
            list(given.figures),
            snakemake.params.settings,
            Path(snakemake.scriptdir).parent / "templates",
            dict(snakemake.output.items()),
        )
