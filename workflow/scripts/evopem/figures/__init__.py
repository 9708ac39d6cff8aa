"""The report's figures, drawn by matplotlib as SVG.

`draw_all` draws them from a data set's result files; `FIGURES` and `FIGURE_NAMES` list them.
"""

from evopem.figures.registry import FIGURE_NAMES, FIGURES, FigureEntry, draw_all
from evopem.results.dataset import Results, read_results, result_paths

__all__ = [
    "FIGURES",
    "FIGURE_NAMES",
    "FigureEntry",
    "Results",
    "draw_all",
    "read_results",
    "result_paths",
]
