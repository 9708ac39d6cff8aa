"""Stabilization diagram: poles over the model order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from evopem.figures.frequency_domain import mark_truth
from evopem.figures.style import (
    ERROR,
    FOURTH,
    MODEL,
    MUTED,
    PAPER,
    Grid,
    decimate,
    figure_of,
    say_nothing_to_draw,
    styled,
)
from evopem.synthesis.truth import Truth

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STABILIZATION = Grid(height=3.5)

# Status of a pole, label, marker, its colour and that of its inside.
STATUS_STYLES = (
    ("new", "new", "o", MUTED, PAPER),
    ("frequency", "stable in frequency", "D", FOURTH, PAPER),
    ("stable", "stable in frequency and damping", "o", MODEL, MODEL),
)


@styled
def draw_stabilization(
    poles: pd.DataFrame,
    sampling_rate: float,
    spectrum: pd.DataFrame | None = None,
    selected_order: int | None = None,
    truth: Truth | None = None,
    order: str = "na",
    axes: Axes | None = None,
) -> Figure:
    """Natural frequencies over the model order, with the spectrum of the output behind.

    Parameters
    ----------
    poles : pandas.DataFrame
        ``order``, ``frequency_hz`` and ``status`` of :class:`.stabilization.StabilizationPole`.
    sampling_rate : float
        Hz.
    spectrum : pandas.DataFrame, optional
        As in ``spectrum.csv``; drawn without a scale of its own.
    selected_order : int, optional
        Selected joint order, marked.
    truth : Truth, optional
        Its modes are marked.
    order : str
        Name of the order.
    axes : matplotlib.axes.Axes, optional
        Where it is drawn; on a new figure by default.
    """
    (axes,) = STABILIZATION.panels(axes)
    if poles.empty:
        say_nothing_to_draw(axes, "No candidate has an oscillating mode.")
        return figure_of(axes)
    if spectrum is not None:
        _draw_behind(axes, spectrum)
    mark_truth(axes, truth)
    for status, label, marker, colour, inside in STATUS_STYLES:
        rows = poles[poles["status"] == status]
        axes.plot(
            rows["frequency_hz"],
            rows["order"],
            linestyle="none",
            label=label,
            markersize=5,
            marker=marker,
            color=colour,
            markerfacecolor=inside,
        )
    if selected_order is not None:
        axes.axhline(selected_order, color=ERROR, linewidth=0.9, linestyle=(0, (3, 2)), zorder=1)
        axes.annotate(
            "selected",
            (1.0, selected_order),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
        )
    axes.set_xlim(0, sampling_rate / 2)
    axes.set_yticks(sorted(poles["order"].unique()))
    axes.margins(y=0.08)
    axes.set_xlabel("Natural frequency (Hz)")
    axes.set_ylabel(f"Order {order}")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1)
    return figure_of(axes)


def _draw_behind(axes: Axes, spectrum: pd.DataFrame) -> None:
    behind = axes.twinx()
    shown = spectrum[(spectrum["frequency_hz"] > 0) & (spectrum["density"] > 0)]
    behind.plot(
        *decimate(shown["frequency_hz"], shown["density"], 400),
        color=MUTED,
        linewidth=0.7,
        alpha=0.6,
    )
    behind.set_yscale("log")
    behind.set_axis_off()
    axes.set_zorder(behind.get_zorder() + 1)
