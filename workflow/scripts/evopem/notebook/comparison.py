"""Models side by side, as an object to look at and plot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from evopem.figures.comparison import (
    MODES,
    RESPONSES,
    SIMULATIONS,
    draw_compared_modes,
    draw_compared_responses,
    draw_compared_simulations,
)
from evopem.files.atomic import write_text
from evopem.notebook.drawing import pyplot_panels
from evopem.pipeline.packages import FOR_FIGURES, FOR_REPORT, check_packages
from evopem.report.comparison_text import comparison_text
from evopem.results.comparison import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from evopem.figures.style import Grid


@dataclass(frozen=True, eq=False, repr=False)
class ModelComparison:
    """Two to six models side by side; in a notebook it shows errors and modes.

    Attributes
    ----------
    comparison : Comparison
    """

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
        return self._on(RESPONSES, axes, draw_compared_responses)

    def plot_simulations(self, axes: Axes | None = None) -> Axes:
        """First validation samples, measured and simulated by every model."""
        return self._on(SIMULATIONS, axes, _on_one(draw_compared_simulations))[0]

    def plot_modes(self, axes: Axes | None = None) -> Axes:
        """Damping over frequency with 95 % intervals; open where a mode is not to be trusted."""
        return self._on(MODES, axes, _on_one(draw_compared_modes))[0]

    def report(self, file: str | Path) -> Path:
        """Write the comparison as one HTML page that loads no other file.

        Raises
        ------
        InputError
            When matplotlib or jinja2 is missing, or the file cannot be written.
        """
        check_packages(FOR_REPORT, "report", "the figures and the page")
        from evopem.report.comparison_page import build_comparison
        from evopem.report.templates import template_folder

        write_text(file, build_comparison(self.comparison, template_folder()))
        return Path(file)

    def _on(self, grid: Grid, axes: Any, draw: Callable[..., object]) -> list[Axes]:
        check_packages(FOR_FIGURES, "plot", "the figures")
        own = pyplot_panels(grid, axes)
        draw(self.comparison, axes=own)
        return own


def _on_one(draw: Callable[..., object]) -> Callable[..., object]:
    """A drawing on one panel, called with a list of one."""

    def on_list(comparison: Comparison, axes: list[Axes]) -> None:
        draw(comparison, axes=axes[0])

    return on_list
