"""Figure of the residual tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import pandas as pd

from evopem.figures.style import (
    ERROR,
    INK,
    MODEL,
    Grid,
    figure_of,
    say_nothing_to_draw,
    stems,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


RESIDUALS = Grid(height=4.4, rows=2)


@styled
def draw_residuals(
    autocorrelation: pd.DataFrame,
    cross_correlation: pd.DataFrame,
    axes: Sequence[Axes] | None = None,
) -> Figure:
    """Residual autocorrelation and residual-input cross-correlation (chapter figure 6).

    Parameters
    ----------
    autocorrelation, cross_correlation : pandas.DataFrame
        As in ``residual_autocorrelation.csv`` and ``cross_correlation.csv``.
    axes : sequence of two matplotlib.axes.Axes, optional
        Where they are drawn; on a new figure by default.
    """
    upper, lower = RESIDUALS.panels(axes)
    # Lag 0 is 1 by definition and would flatten all other lags.
    lags = autocorrelation[autocorrelation["lag"] > 0]
    _correlation(upper, lags, "autocorrelation")
    upper.set_title("Autocorrelation of the residuals")
    upper.set_xlabel("Lag (samples); lag 0, where it is 1, is not drawn")
    upper.set_ylabel("Autocorrelation")
    if cross_correlation["cross_correlation"].isna().all():
        say_nothing_to_draw(lower, "There is no cross-correlation with an input.")
    else:
        _correlation(lower, cross_correlation, "cross_correlation")
        lower.axvline(0, color=INK, linewidth=0.7)
        lower.set_xlabel("Lag (samples); at positive lags the residual follows the input")
        lower.set_ylabel("Cross-correlation")
    lower.set_title("Cross-correlation of residuals and input")
    upper.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
    return figure_of(upper)


def _correlation(axes: Axes, table: pd.DataFrame, column: str) -> None:
    inside = table[column].abs() <= table["bound95"]
    width = max(0.35, min(1.4, 300.0 / max(len(table), 1)))
    for rows, colour, label in (
        (table[inside], INK, "inside"),
        (table[~inside], ERROR, "outside"),
    ):
        x, y = stems(rows["lag"], rows[column])
        axes.plot(x, y, color=colour, linewidth=width, solid_capstyle="butt", label=label)
    outside = table[~inside]
    axes.plot(outside["lag"], outside[column], ".", color=ERROR, markersize=3)
    for sign in (-1, 1):
        axes.plot(
            table["lag"],
            sign * table["bound95"],
            color=MODEL,
            linewidth=1.0,
            linestyle=(0, (4, 2)),
            label="95 % bounds" if sign > 0 else None,
        )
    axes.margins(x=0.01)
    largest = (
        max(float(table[column].abs().max()), float(table["bound95"].max())) if len(table) else 1
    )
    axes.set_ylim(-1.15 * largest, 1.15 * largest)
