"""Comparison: the results of several data sets on one page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from evopem.errors import InputError
from evopem.figures.comparison import Comparison
from evopem.files.atomic import write_page
from evopem.pipeline.figures import read_results
from evopem.report.comparison import build_comparison
from evopem.report.templates import template_folder
from evopem.results.identity import check_results
from evopem.results.layout import DatasetFiles


def compare_datasets(folders: Sequence[str], page: str) -> Comparison:
    """Lay the results of data sets side by side, on a page with links to their reports."""
    found = [_files(folder) for folder in folders]
    comparison = Comparison.of([read_results(files) for files in found])
    reports = {
        label: quote(Path(os.path.relpath(files.report, Path(page).parent)).as_posix())
        for label, files in zip(comparison.labels, found, strict=True)
        if Path(files.report).is_file()
    }
    write_page(page, build_comparison(comparison, template_folder(), reports))
    return comparison


def _files(folder: str) -> DatasetFiles:
    files = DatasetFiles(folder)
    if not Path(files.config).is_file():
        raise InputError(
            folder,
            "holds no results of a data set",
            "give folders such as results/arm, as the workflow or `evopem FILE` makes them",
        )
    check_results(files)
    return files
