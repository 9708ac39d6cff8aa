"""Figures of the model's responses to a step and to an impulse."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.figures.style import MODEL, new_figure, styled, with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from evopem.estimation.model_record import ModelRecord

FEWEST_SAMPLES, MOST_SAMPLES = 50, 1000
# Share of its largest value below which the impulse response has settled.
REMAINDER = 0.01


def time_response_table(record: ModelRecord) -> pd.DataFrame:
    """Response of G to a unit impulse (one sample of 1) and a unit step at time 0.

    Parameters
    ----------
    record : ModelRecord

    Returns
    -------
    pandas.DataFrame
        ``time_s``, ``impulse_response`` and ``step_response``, in units of the prepared output
        for one unit of the prepared input.
    """
    model = record.model
    impulse = np.zeros(MOST_SAMPLES)
    impulse[0] = 1.0
    response = np.asarray(model.simulate(impulse))
    size = np.abs(response)
    # Both responses have settled where the impulse response stays small.
    settled = int(np.flatnonzero(size > REMAINDER * size.max()).max(initial=0))
    response = response[: max(round(1.2 * settled), FEWEST_SAMPLES)]
    return pd.DataFrame(
        {
            "time_s": np.arange(response.size) / record.sampling_rate,
            "impulse_response": response,
            "step_response": np.cumsum(response),
        }
    )


@styled
def draw_step_and_impulse(table: pd.DataFrame, unit: str = "") -> Figure:
    """Responses to a unit step and a unit impulse.

    Parameters
    ----------
    table : pandas.DataFrame
        As :func:`time_response_table` returns it.
    unit : str
        Unit of the output for one unit of the input, "" when not stated.
    """
    figure = new_figure(4.2)
    for axes, column, title in zip(
        figure.subplots(2, 1, sharex=True),
        ("step_response", "impulse_response"),
        ("Step", "Impulse (one sample of 1)"),
        strict=True,
    ):
        axes.plot(table["time_s"], table[column], color=MODEL)
        axes.set_title(title)
        axes.set_ylabel(with_unit("Response", unit))
        axes.margins(x=0.01)
    axes.set_xlabel("Time (s)")
    return figure
