"""Figure of the prediction error against the horizon."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pandas as pd

from evopem.figures.style import ERROR, MODEL, PAPER, logarithmic_if_wide, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def draw_horizons(horizons: pd.DataFrame, simulation_error: float = math.nan) -> Figure:
    """Error of k-step predictions against k, with that of the simulation.

    Parameters
    ----------
    horizons : pandas.DataFrame
        As in ``horizons.csv``.
    simulation_error : float
        Percent; NaN where there is no simulation.
    """
    from matplotlib.ticker import NullLocator

    figure = new_figure(2.8)
    axes = figure.subplots()
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
    return figure
