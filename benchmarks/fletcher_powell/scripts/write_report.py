"""Write the page of the comparison, and its tables as Markdown."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import product_path  # noqa: F401
from evopem.files.atomic import write_text
from evopem.files.job import job
from evopem.files.json_form import from_json, load
from fletcher_powell.hypotheses import Hypothesis
from fletcher_powell.markdown import comparison_markdown
from fletcher_powell.page import build_page
from fletcher_powell.settings import Settings
from fletcher_powell.tables import read_tables

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake


def main(
    table_files: Sequence[str],
    hypotheses_file: str,
    figure_files: Sequence[str],
    settings: Settings,
    product_templates: Path,
    outputs: Mapping[str, str],
) -> None:
    tables = read_tables(*table_files)
    hypotheses = load(tuple[Hypothesis, ...], hypotheses_file)
    figures = {Path(file).stem: Path(file).read_text(encoding="utf-8") for file in figure_files}
    page = build_page(tables, hypotheses, figures, settings, product_templates)
    write_text(outputs["report"], page)
    write_text(outputs["text"], comparison_markdown(tables.summary, hypotheses, settings))


if __name__ == "__main__":
    with job(snakemake.log[0], snakemake.input, snakemake.output):
        given = snakemake.input
        main(
            [given.table, given.runs, given.convergence, given.landscape, given.minima],
            given.hypotheses,
            list(given.figures),
            from_json(Settings, snakemake.params.settings),
            Path(snakemake.scriptdir).parents[2] / "workflow" / "templates",
            dict(snakemake.output.items()),
        )
