"""Figures of the model's responses to a step and to an impulse."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.figures.style import MODEL, Grid, figure_of, styled, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RESPONSE = Grid(height=2.6)
BOTH_RESPONSES = Grid(height=4.2, rows=2, sharex=True)

FEWEST_SAMPLES = 50
# Share of its largest value below which an impulse response has settled.
REMAINDER = 0.01
# Column and title of the responses to an input; without an input, of that to the innovations.
OF_PLANT = (("step", "Step response"), ("impulse", "Impulse response (one sample of 1)"))
OF_NOISE = (("noise_impulse", "Impulse response of the noise filter (one sample of 1)"),)


def responses_of(table: pd.DataFrame) -> tuple[tuple[str, str], ...]:
    """Column and title of each response that a table has.

    Parameters
    ----------
    table : pandas.DataFrame
        As in ``time_response.csv``.
    """
    return OF_PLANT if table["impulse"].notna().any() else OF_NOISE


def settling_part(table: pd.DataFrame) -> pd.DataFrame:
    """The responses and their 95 % intervals until the impulse response stays small.

    Parameters
    ----------
    table : pandas.DataFrame
        As in ``time_response.csv``.
    """
    names = [name for name, _ in responses_of(table)]
    size = np.abs(table[names[-1]].to_numpy())
    settled = int(np.flatnonzero(size > REMAINDER * size.max()).max(initial=0))
    columns = [f"{name}{end}" for name in names for end in ("", "_lower", "_upper")]
    return table[["time_s", *columns]].iloc[: max(round(1.2 * settled), FEWEST_SAMPLES)]


@styled
def draw_step_and_impulse(
    table: pd.DataFrame, responses: tuple[tuple[str, str], ...] = OF_PLANT, unit: str = ""
) -> Figure:
    """Responses to a unit step and a unit impulse with their 95 % bands.

    Parameters
    ----------
    table : pandas.DataFrame
        As :func:`settling_part` returns it.
    responses : tuple of (column, title)
        As :func:`responses_of` returns them.
    unit : str
        Unit of the output for one unit of the input, "" when not stated.
    """
    panels = (BOTH_RESPONSES if len(responses) > 1 else RESPONSE).panels()
    for axes, (column, title) in zip(panels, responses, strict=True):
        draw_response(axes, table, column, title, unit)
    panels[-1].set_xlabel("Time (s)")
    return figure_of(panels[-1])


@styled
def draw_response(axes: Axes, table: pd.DataFrame, column: str, title: str, unit: str = "") -> None:
    """One response over time with its 95 % band, where that is known."""
    if table[f"{column}_lower"].notna().any():
        axes.fill_between(
            table["time_s"],
            table[f"{column}_lower"],
            table[f"{column}_upper"],
            color=MODEL,
            alpha=0.28,
            linewidth=0,
        )
    axes.plot(table["time_s"], table[column], color=MODEL)
    axes.set_title(title)
    axes.set_ylabel(with_unit("Response", unit))
    axes.margins(x=0.01)
