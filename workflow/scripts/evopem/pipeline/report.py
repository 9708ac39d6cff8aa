"""Report: one self-contained HTML file for a data set."""

from __future__ import annotations

from evopem.results.layout import DatasetFiles


def write_report(files: DatasetFiles) -> None:
    """Set the results and figures of one data set into one HTML file."""
