"""Figures of the search: criteria over delay and orders, and its convergence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from evopem.figures.style import (
    ERROR,
    FAMILY,
    FAMILY_LINES,
    FAMILY_MARKERS,
    INK,
    LABEL_BOX,
    MODEL,
    PAPER,
    logarithmic,
    new_figure,
    power_of_ten,
    say_nothing_to_draw,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CRITERIA = (("rss", "RSS (%)"), ("bic", "BIC"))
# Least height of a convergence plot, as a share of the objective.
SMALLEST_SPAN = 0.01
# Phase, the order it varies, title.
PHASES = (
    ("common", "na", "Common order: na = nb = nc = k"),
    ("c", "nc", "Order of C: nc = k"),
    ("b", "nb", "Coefficients of B: nb = k"),
)


def _selected(candidates: pd.DataFrame) -> pd.DataFrame:
    return candidates[candidates["selected"].astype(str).str.lower().isin({"true", "1", "1.0"})]


@styled
def draw_delay(candidates: pd.DataFrame) -> Figure:
    """RSS and BIC against the order, one line a delay (chapter figure 5).

    Parameters
    ----------
    candidates : pandas.DataFrame
        As in ``candidates.csv``.
    """
    figure = new_figure(3.1)
    panels = figure.subplots(1, 2)
    tried = candidates[candidates["phase"] == "delay"]
    if tried.empty:
        for axes in panels:
            say_nothing_to_draw(axes, "No delay search on record.")
        return figure
    chosen = _selected(tried)
    delay = None if chosen.empty else int(chosen["nk"].iloc[0])
    for axes, (column, label) in zip(panels, CRITERIA, strict=True):
        for number, (nk, group) in enumerate(tried.groupby("nk")):
            line = group.sort_values("na")
            style = number % len(FAMILY)
            axes.plot(
                line["na"],
                line[column],
                color=FAMILY[style],
                linestyle=FAMILY_LINES[style],
                marker=FAMILY_MARKERS[style],
                linewidth=2.2 if nk == delay else 1.1,
                label=f"nk = {nk}" + (" (chosen)" if nk == delay else ""),
            )
        _whole_numbers(axes)
        axes.set_xlabel("Order k of ARMAX(k, k, k, nk)")
        axes.set_ylabel(label)
        _logarithmic_if_wide(axes, tried[column])
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=6)
    return figure


@styled
def draw_phases(candidates: pd.DataFrame) -> Figure:
    """RSS and BIC against k for each of the three phases, the choice marked."""
    figure = new_figure(4.3)
    panels = figure.subplots(2, 3, sharex="col")
    for column, (phase, order, title) in enumerate(PHASES):
        tried = candidates[candidates["phase"] == phase].sort_values(order)
        panels[0, column].set_title(title, fontsize=8)
        if tried.empty:
            for axes in panels[:, column]:
                say_nothing_to_draw(axes, "Not searched.")
            continue
        chosen = _selected(tried)
        for axes, (criterion, label) in zip(panels[:, column], CRITERIA, strict=True):
            axes.plot(
                tried[order],
                tried[criterion],
                color=MODEL,
                marker="o",
                markerfacecolor=PAPER,
                markersize=4,
            )
            if not chosen.empty:
                k = int(chosen[order].iloc[0])
                axes.axvline(k, color=ERROR, linewidth=0.9, linestyle=(0, (3, 2)), zorder=1)
                axes.plot([k], chosen[criterion].iloc[:1], "o", color=ERROR, markersize=6.5)
                if criterion == "rss":
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
            _whole_numbers(axes)
            _logarithmic_if_wide(axes, tried[criterion])
            if column == 0:
                axes.set_ylabel(label)
        panels[1, column].set_xlabel("k")
    return figure


def _whole_numbers(axes: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=8, integer=True))


def _logarithmic_if_wide(axes: Axes, values: pd.Series) -> None:
    """Spread values over decades where one bad candidate would flatten the rest.

    Small values are labelled one by one rather than with a common factor above the axis.
    """
    finite = values[np.isfinite(values)]
    if len(finite) and finite.min() > 0 and finite.max() > 8 * finite.min():
        logarithmic(axes)
    elif len(finite) and 0 < finite.max() < 1e-3:
        axes.yaxis.set_major_formatter(power_of_ten)


@styled
def draw_convergence(candidate: Mapping[str, Any] | None) -> Figure:
    """Best objective against evaluations for one candidate's search.

    Parameters
    ----------
    candidate : mapping, optional
        A candidate record with ``convergence``, pairs of evaluations and best objective.
    """
    figure = new_figure(2.8)
    axes = figure.subplots()
    history = np.asarray((candidate or {}).get("convergence") or [], dtype=float)
    if history.ndim != 2 or history.shape[1] != 2:
        say_nothing_to_draw(axes, "The search left no history.")
        return figure
    evaluations, best = history.T
    axes.step(evaluations, best, where="post", color=MODEL, linewidth=1.4)
    axes.plot(evaluations, best, "o", color=MODEL, markersize=3)
    axes.plot(evaluations[-1:], best[-1:], "o", color=ERROR, markersize=6.5)
    axes.annotate(
        f"{best[-1]:.6g}",
        (evaluations[-1], best[-1]),
        xytext=(-4, 8),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        color=INK,
    )
    axes.set_xlim(left=0)
    axes.margins(y=0.12)
    _logarithmic_if_wide(axes, pd.Series(best))
    if np.ptp(best) < SMALLEST_SPAN * abs(best[-1]):
        # The last digits of a search that was over at once are not made to look like a descent.
        middle, half = float(np.mean(best)), SMALLEST_SPAN / 2 * abs(best[-1])
        axes.set_ylim(middle - half, middle + half)
    axes.set_xlabel("Objective evaluations (a gradient counts as one more)")
    axes.set_ylabel("Best objective")
    return figure
