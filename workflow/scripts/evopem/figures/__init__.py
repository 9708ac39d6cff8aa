"""The figures of the report, drawn by matplotlib as SVG."""

from evopem.figures.registry import REPORT_FIGURES, ReportFigure, draw_all

__all__ = ["REPORT_FIGURES", "ReportFigure", "draw_all"]
