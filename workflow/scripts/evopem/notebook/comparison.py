"""Models side by side, as an object to look at and plot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from evopem.figures.chart import Chart
from evopem.figures.comparison import (
    Comparison,
    compared_modes,
    compared_responses,
    compared_simulations,
)
from evopem.figures.draw import draw, grid_of
from evopem.figures.style import PARAMETERS, Grid
from evopem.files.atomic import write_page
from evopem.pipeline.packages import FOR_FIGURES, FOR_REPORT, check_packages
from evopem.report.comparison import comparison_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# A notebook's page may be dark, and the figures are drawn for paper.
_PAPER = {"figure.facecolor": "white", "axes.facecolor": "white", "savefig.facecolor": "white"}


def pyplot_panels(grid: Grid, axes: Any = None) -> list[Axes]:
    """The given axes, or those of a new figure that pyplot keeps and a notebook shows."""
    if axes is not None:
        return grid.panels(axes)
    from matplotlib import pyplot, rc_context

    # The backend starts with the first figure and sets parameters of its own, such as that figures
    # are shown: a context around its start would take these back.
    if getattr(pyplot, "_backend_mod", None) is None:
        pyplot.close(pyplot.figure())
    with rc_context(PARAMETERS | _PAPER):
        size = (grid.width, grid.height)
        return grid.on(pyplot.figure(figsize=size, layout="constrained"))


@dataclass(frozen=True, eq=False, repr=False)
class ModelComparison:
    """Two to six models side by side; in a notebook it shows errors and modes."""

    comparison: Comparison

    @property
    def table(self) -> pd.DataFrame:
        """A row for each model: orders, errors on validation samples, criteria and checks."""
        return self.comparison.table

    @property
    def modes(self) -> pd.DataFrame:
        """A row for each mode of each model; equal numbers are the same mode."""
        return self.comparison.mode_table

    def __repr__(self) -> str:
        return comparison_text(self.comparison)

    def _repr_html_(self) -> str:
        tables = [self.table, self.modes.set_index(["mode", "data set"])]
        return "".join(each.to_html(float_format="{:.4g}".format) for each in tables)

    def plot_frequency_responses(self, axes: Sequence[Axes] | None = None) -> list[Axes]:
        """Gain and phase of every model, on two axes."""
        return self._on(compared_responses(self.comparison), axes)

    def plot_simulations(self, axes: Axes | None = None) -> Axes:
        """First validation samples, measured and simulated by every model."""
        return self._on(compared_simulations(self.comparison), axes)[0]

    def plot_modes(self, axes: Axes | None = None) -> Axes:
        """Damping over frequency with 95 % intervals; open where a mode is not to be trusted."""
        return self._on(compared_modes(self.comparison), axes)[0]

    def report(self, file: str | Path) -> Path:
        """Write the comparison as one HTML page that loads no other file.

        Raises
        ------
        InputError
            When matplotlib or jinja2 is missing, or the file cannot be written.
        """
        check_packages(FOR_REPORT, "report", "the figures and the page")
        from evopem.report.comparison import build_comparison
        from evopem.report.templates import template_folder

        write_page(file, build_comparison(self.comparison, template_folder()))
        return Path(file)

    def _on(self, chart: Chart, axes: Any) -> list[Axes]:
        check_packages(FOR_FIGURES, "plot", "the figures")
        own = pyplot_panels(grid_of(chart), axes)
        draw(chart, own)
        return own
