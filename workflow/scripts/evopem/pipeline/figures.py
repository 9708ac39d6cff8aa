"""Figures: one SVG file for each figure of the report."""

from __future__ import annotations

from pathlib import Path

from evopem.config.yaml_form import read_settings
from evopem.figures.registry import draw_all
from evopem.figures.view import Results
from evopem.results.dataset import read_dataset_results
from evopem.results.layout import DatasetFiles


def draw_figures(files: DatasetFiles) -> None:
    """Draw every figure of one data set from its results."""
    draw_all(read_results(files), Path(files.figures[0]).parent)


def read_results(files: DatasetFiles) -> Results:
    """All results of one data set."""
    return read_dataset_results(files, read_settings(files.config))
