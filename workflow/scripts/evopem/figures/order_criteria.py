"""Figures of the order search: RSS and BIC of the candidates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from evopem.config.structures import (
    AUTOMATIC_PHASES,
    ORDER_NAMES,
    STRUCTURES,
    phases_of,
    plant_order,
    structure_name,
    varied_order,
)
from evopem.figures.style import (
    ERROR,
    FAMILY,
    FAMILY_LINES,
    FAMILY_MARKERS,
    INK,
    LABEL_BOX,
    MODEL,
    PAPER,
    logarithmic_if_wide,
    new_figure,
    say_nothing_to_draw,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CRITERIA = (("rss", "RSS (%)"), ("bic", "BIC"))
TITLES = {
    "nc": "Order of C: nc = k",
    "nd": "Order of D: nd = k",
    "na": "Order of A: na = k",
    "nb": "Coefficients of B: nb = k",
}


@styled
def draw_delay(candidates: pd.DataFrame, structure: str = "armax") -> Figure:
    """RSS and BIC against the order, one line for each delay (chapter figure 5).

    Parameters
    ----------
    candidates : pandas.DataFrame
        As in ``candidates.csv``.
    structure : str
    """
    figure = new_figure(3.1)
    panels = figure.subplots(1, 2)
    tried = candidates[candidates["phase"] == "delay"]
    if tried.empty:
        for axes in panels:
            say_nothing_to_draw(axes, "There are no candidates of the delay search.")
        return figure
    order = plant_order(structure)
    selected = tried[tried["selected"]]
    delay = None if selected.empty else int(selected["nk"].iloc[0])
    for axes, (column, label) in zip(panels, CRITERIA, strict=True):
        for number, (nk, group) in enumerate(tried.groupby("nk")):
            line = group.sort_values(order)
            style = number % len(FAMILY)
            axes.plot(
                line[order],
                line[column],
                color=FAMILY[style],
                linestyle=FAMILY_LINES[style],
                marker=FAMILY_MARKERS[style],
                linewidth=2.2 if nk == delay else 1.1,
                label=f"nk = {nk}" + (" (selected)" if nk == delay else ""),
            )
        _whole_numbers(axes)
        axes.set_xlabel(
            f"Order k of {structure_name(structure)} models with {tied_text(structure)}"
        )
        axes.set_ylabel(label)
        logarithmic_if_wide(axes, tried[column])
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=6)
    return figure


@styled
def draw_phases(candidates: pd.DataFrame, structure: str = "armax") -> Figure:
    """RSS and BIC against k for each phase of the orders, the selection marked.

    Parameters
    ----------
    candidates : pandas.DataFrame
        As in ``candidates.csv``.
    structure : str
    """
    figure = new_figure(4.3)
    phases = [phase for phase in phases_of(structure) if phase != "delay"]
    panels = figure.subplots(2, len(phases), sharex="col", squeeze=False)
    for column, phase in enumerate(phases):
        order = varied_order(phase, structure)
        title = TITLES.get(phase, f"Joint order: {tied_text(structure)}")
        tried = candidates[candidates["phase"] == phase].sort_values(order)
        panels[0, column].set_title(title, fontsize=8)
        if tried.empty:
            for axes in panels[:, column]:
                say_nothing_to_draw(axes, "Not searched.")
            continue
        for axes, (criterion, label) in zip(panels[:, column], CRITERIA, strict=True):
            axes.plot(
                tried[order],
                tried[criterion],
                color=MODEL,
                marker="o",
                markerfacecolor=PAPER,
                markersize=4,
            )
            _mark_selection(axes, tried, order, criterion)
            _whole_numbers(axes)
            logarithmic_if_wide(axes, tried[criterion])
            if column == 0:
                axes.set_ylabel(label)
        panels[1, column].set_xlabel("k")
    return figure


@styled
def draw_structures(candidates: pd.DataFrame) -> Figure:
    """RSS and BIC against the number of coefficients, one line for each structure.

    A line joins the best candidates of a structure with each number of coefficients.

    Parameters
    ----------
    candidates : pandas.DataFrame
        As in ``candidates.csv``, of the automatic recipe.
    """
    figure = new_figure(3.4)
    panels = figure.subplots(1, 2)
    tried = candidates[candidates["phase"] == AUTOMATIC_PHASES[0]]
    orders = [name for name in ORDER_NAMES if name != "nk"]
    counted = tried.assign(
        coefficients=tried[orders].sum(axis=1), structure=tried["model"].str.split("(").str[0]
    )
    for axes, (column, label) in zip(panels, CRITERIA, strict=True):
        for number, (structure, group) in enumerate(counted.groupby("structure", sort=False)):
            best = group.groupby("coefficients")[column].min()
            round_, style = divmod(number, len(FAMILY))
            axes.plot(
                best.index,
                best,
                color=FAMILY[style],
                linestyle=FAMILY_LINES[style],
                marker=FAMILY_MARKERS[(style + round_) % len(FAMILY)],
                markersize=3.5,
                linewidth=1.1,
                label=structure,
            )
        chosen = counted[counted["selected"]]
        axes.plot(chosen["coefficients"], chosen[column], "o", color=ERROR, markersize=6.5)
        _whole_numbers(axes)
        axes.set_xlabel("Coefficients")
        axes.set_ylabel(label)
        logarithmic_if_wide(axes, counted[column])
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=7)
    return figure


def tied_text(structure: str) -> str:
    """The orders that equal the joint order k, such as "na = nb = nc = k".

    Examples
    --------
    >>> tied_text("armax"), tied_text("bj")
    ('na = nb = nc = k', 'nb = nf = k')
    """
    plant = ("nb", "nf") if "nf" in STRUCTURES[structure] else ("na", "nb")
    noise = {"arma": ("nc",), "armax": ("nc",)}.get(structure, ())
    tied = [name for name in (*plant, *noise) if name in STRUCTURES[structure]]
    return " = ".join([*tied, "k"])


def _mark_selection(axes: Axes, tried: pd.DataFrame, order: str, criterion: str) -> None:
    """Mark the selected candidate, with its order in the upper panels."""
    selected = tried[tried["selected"]]
    if selected.empty:
        return
    k = int(selected[order].iloc[0])
    axes.axvline(k, color=ERROR, linewidth=0.9, linestyle=(0, (3, 2)), zorder=1)
    axes.plot([k], selected[criterion].iloc[:1], "o", color=ERROR, markersize=6.5)
    if criterion != "rss":
        return
    beyond = k > 0.7 * tried[order].max() + 0.3 * tried[order].min()
    axes.annotate(
        f"k = {k}",
        (k, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(-4 if beyond else 4, -9),
        textcoords="offset points",
        ha="right" if beyond else "left",
        fontsize=8,
        color=INK,
        bbox=LABEL_BOX,
    )


def _whole_numbers(axes: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=8, integer=True))
