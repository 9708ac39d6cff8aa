"""Figures: one SVG file for each figure of the report."""

from __future__ import annotations

from pathlib import Path

from evopem.config.settings import DatasetSettings
from evopem.config.yaml_form import read_settings
from evopem.figures.registry import draw_all
from evopem.results.dataset import read_dataset_results
from evopem.results.layout import DatasetFiles
from evopem.results.multichannel import read_multichannel_results


def draw_figures(files: DatasetFiles) -> None:
    """Draw every figure of one data set from its results."""
    results = read_dataset_results(files, read_settings(files.config))
    draw_all(results, Path(files.figures[0]).parent)


def draw_channel_figures(
    files: DatasetFiles, settings: DatasetSettings, structures: tuple[str, ...]
) -> None:
    """The same of a data set with several channels."""
    results = read_multichannel_results(files, settings, structures)
    draw_all(results, Path(files.figures[0]).parent)
