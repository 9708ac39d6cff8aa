"""The report of a data set with several channels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from evopem.automatic.variant_search import Variant
from evopem.config.state_space_settings import MultichannelDataset
from evopem.files.atomic import write_text
from evopem.pipeline.commit import commit_of
from evopem.report.state_space_page import build_state_space_report
from evopem.report.templates import template_folder
from evopem.report.wall_clock import read_wall_clock
from evopem.results.layout import DatasetFiles
from evopem.results.multichannel import read_multichannel_results


def write_state_space_report(
    files: DatasetFiles, settings: MultichannelDataset, variants: Sequence[Variant]
) -> None:
    """Write the report of a data set as one HTML file."""
    results = read_multichannel_results(files, settings, [each.name for each in variants])
    templates = template_folder()
    wall_clock = read_wall_clock(Path(files.folder) / "benchmarks")
    commit = commit_of(templates.parent)
    page = build_state_space_report(results, wall_clock, templates, commit)
    write_text(files.report, page)
