"""Report: one self-contained HTML file for a data set."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from evopem.automatic.variant_search import Variant
from evopem.config.state_space_settings import MultichannelDataset
from evopem.config.yaml_form import read_settings
from evopem.figures.view import Results
from evopem.files.atomic import write_text
from evopem.pipeline.commit import commit_of
from evopem.report.page import build_report
from evopem.report.templates import template_folder
from evopem.report.wall_clock import read_wall_clock
from evopem.results.dataset import read_dataset_results
from evopem.results.layout import FIGURES, DatasetFiles
from evopem.results.multichannel import read_multichannel_results


def write_report(files: DatasetFiles) -> None:
    """Set the results and figures of one data set into one HTML file.

    It names the commit of the workflow that it belongs to.
    """
    results = read_dataset_results(files, read_settings(files.config))
    write_text(files.report, report_page(files, results, _figures(files)))


def write_channel_report(
    files: DatasetFiles, settings: MultichannelDataset, variants: tuple[Variant, ...]
) -> None:
    """The same of a data set with several channels."""
    results = read_multichannel_results(files, settings, [each.name for each in variants])
    write_text(files.report, report_page(files, results, _figures(files)))


def _figures(files: DatasetFiles) -> dict[str, str]:
    return {name: Path(files.figure(name)).read_text(encoding="utf-8") for name in FIGURES}


def report_page(
    files: DatasetFiles,
    results: Results,
    figures: Mapping[str, str],
    templates: Path | None = None,
) -> str:
    """The report of results and figures that are at hand.

    Parameters
    ----------
    files : DatasetFiles
        Where the results lie.
    results : results of a data set
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
