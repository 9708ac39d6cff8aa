"""The report of a data set, and the list of several, as self-contained HTML pages."""

from evopem.report.index_page import build_index
from evopem.report.page import build_report, read_wall_clock

__all__ = ["build_index", "build_report", "read_wall_clock"]
