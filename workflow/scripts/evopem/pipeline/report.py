"""Report: one self-contained HTML file for a data set."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from evopem.config.yaml_form import read_settings
from evopem.files.atomic import write_text
from evopem.pipeline.commit import commit_of
from evopem.report.page import build_report
from evopem.report.templates import template_folder
from evopem.report.wall_clock import read_wall_clock
from evopem.results.dataset import DatasetResults, read_dataset_results
from evopem.results.layout import FIGURES, DatasetFiles


def write_report(files: DatasetFiles, templates: Path) -> None:
    """Set the results and figures of one data set into one HTML file.

    Parameters
    ----------
    files : DatasetFiles
    templates : Path
        The folder of ``report.html.j2``. The report names the commit of the workflow that it
        belongs to.
    """
    results = read_dataset_results(files, read_settings(files.config))
    figures = {name: Path(files.figure(name)).read_text(encoding="utf-8") for name in FIGURES}
    write_text(files.report, report_page(files, results, figures, templates))


def report_page(
    files: DatasetFiles,
    results: DatasetResults,
    figures: Mapping[str, str],
    templates: Path | None = None,
) -> str:
    """The report of results and figures that are at hand.

    Parameters
    ----------
    files : DatasetFiles
        Where the results lie.
    results : DatasetResults
    figures : mapping of str to str
        SVG texts by the names of the figures.
    templates : Path, optional
        That of the package by default.
    """
    templates = templates or template_folder()
    return build_report(
        results,
        figures,
        read_wall_clock(Path(files.folder) / "benchmarks"),
        Path(files.config).read_text(encoding="utf-8"),
        templates,
        commit_of(templates.parent),
    )
