"""Reports: one self-contained HTML file for a data set, and an index over several."""

from evopem.report.page import build_index, build_report

__all__ = ["build_index", "build_report"]
