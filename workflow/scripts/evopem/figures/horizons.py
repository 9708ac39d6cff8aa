"""Figure of the prediction error against the horizon."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pandas as pd

from evopem.figures.style import (
    ERROR,
    MODEL,
    PAPER,
    Grid,
    figure_of,
    logarithmic_if_wide,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HORIZONS = Grid(height=2.8)


@styled
def draw_horizons(
    horizons: pd.DataFrame, simulation_error: float = math.nan, axes: Axes | None = None
) -> Figure:
    """Error of k-step predictions against k, with that of the simulation.

    Parameters
    ----------
    horizons : pandas.DataFrame
        As in ``horizons.csv``.
    simulation_error : float
        Percent; NaN where there is no simulation.
    axes : matplotlib.axes.Axes, optional
        Where it is drawn; on a new figure by default.
    """
    from matplotlib.ticker import NullLocator

    (axes,) = HORIZONS.panels(axes)
    axes.plot(
        horizons["horizon"],
        horizons["error_percent"],
        color=MODEL,
        marker="o",
        markerfacecolor=PAPER,
        markersize=4,
        label="k-step prediction",
    )
    if math.isfinite(simulation_error):
        axes.axhline(
            simulation_error,
            color=ERROR,
            linewidth=1.0,
            linestyle=(0, (4, 2)),
            label="simulation",
        )
    axes.set_xscale("log")
    axes.set_xticks(horizons["horizon"], horizons["horizon"].astype(str))
    axes.xaxis.set_minor_locator(NullLocator())
    logarithmic_if_wide(axes, horizons["error_percent"])
    axes.margins(y=0.12)
    axes.set_xlabel("Horizon k (samples)")
    axes.set_ylabel("Relative error (%)")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
    return figure_of(axes)
