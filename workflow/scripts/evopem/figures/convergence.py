"""Figure of the search: its lowest objective over the evaluations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.figures.style import (
    ERROR,
    INK,
    MODEL,
    logarithmic_if_wide,
    new_figure,
    say_nothing_to_draw,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Smallest height of the plot, as a share of the objective.
SMALLEST_SPAN = 0.01


@styled
def draw_convergence(history: Sequence[tuple[int, float]]) -> Figure:
    """Lowest objective against evaluations, of the search for one model.

    Parameters
    ----------
    history : sequence of (evaluations, lowest objective)
    """
    figure = new_figure(2.8)
    axes = figure.subplots()
    if not history:
        say_nothing_to_draw(axes, "The history of the search is empty.")
        return figure
    evaluations, best = np.asarray(history, dtype=float).T
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
    logarithmic_if_wide(axes, pd.Series(best))
    if np.ptp(best) < SMALLEST_SPAN * abs(best[-1]):
        # Differences in the last digits alone must not look like a descent.
        middle, half = float(np.mean(best)), SMALLEST_SPAN / 2 * abs(best[-1])
        axes.set_ylim(middle - half, middle + half)
    axes.set_xlabel("Objective evaluations (a gradient counts as one more)")
    axes.set_ylabel("Lowest objective")
    return figure
