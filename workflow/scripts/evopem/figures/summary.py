"""The two figures of a report's first screen: the simulation and the gain, over the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import pandas as pd

from evopem.figures.frequency_domain import (
    NOISE_FILTER,
    draw_gain,
    plant_or_noise_filter,
    with_positive_frequency,
)
from evopem.figures.style import ERROR, INK, MODEL, Grid, decimate, figure_of, styled
from evopem.figures.time_domain import DASHED, folded, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from evopem.models.modes import Mode

SUMMARY = Grid(height=3.1, width=5.2)  # two stand side by side
# So many periods of the lowest mode are shown, between the two limits in samples.
PERIODS = 12
FEWEST_SAMPLES, MOST_SAMPLES = 60, 400


@styled
def draw_measured_and_simulated(
    simulation: pd.DataFrame,
    modes: Sequence[Mode],
    sampling_rate: float,
    label: str,
    axes: Axes | None = None,
) -> Figure:
    """Measured and simulated output over the first scored validation samples.

    Of a model without input, the output predicted one step ahead.

    Parameters
    ----------
    simulation : pandas.DataFrame
        As in ``simulation.csv``.
    modes : sequence of Mode
        The lowest of them sets the time that is shown.
    sampling_rate : float
        Hz.
    label : str
        Name of the prepared output with its unit.
    axes : matplotlib.axes.Axes, optional
        Where it is drawn; on a new figure by default.
    """
    (axes,) = SUMMARY.panels(axes)
    computed = simulated_or_predicted(simulation)
    scored = simulation[simulation[computed].notna()]
    shown = scored.iloc[: shown_samples(modes, sampling_rate)]
    for column, colour, style, name in (
        ("output", INK, "-", "measured"),
        (computed, ERROR, DASHED, computed),
    ):
        x, y = decimate(shown["time_s"], shown[column])
        axes.plot(x, y, color=colour, linestyle=style, label=name)
    axes.set_xlabel("Time from the first validation sample (s)")
    axes.set_ylabel(folded(label))
    axes.margins(x=0.01)
    legend_above(axes)
    return figure_of(axes)


def simulated_or_predicted(simulation: pd.DataFrame) -> str:
    """The column of the simulated output; without an input, of the predicted one."""
    return "simulated" if simulation["simulated"].notna().any() else "predicted"


def shown_samples(modes: Sequence[Mode], sampling_rate: float) -> int | None:
    """Samples over which the simulation is shown; None for all, where nothing oscillates."""
    if not modes:
        return None
    lowest = max(min(mode.frequency_hz for mode in modes), sampling_rate / MOST_SAMPLES)
    return min(max(round(PERIODS * sampling_rate / lowest), FEWEST_SAMPLES), MOST_SAMPLES)


@styled
def draw_gain_and_data(
    response: pd.DataFrame,
    spectrum: pd.DataFrame,
    trusted: Sequence[float],
    unit: str = "",
    axes: Axes | None = None,
) -> Figure:
    """Gain of the model with its 95 % band over the multitaper estimate, with the modes marked.

    Of a model without input the gain of its noise filter, without an estimate.

    Parameters
    ----------
    response, spectrum : pandas.DataFrame
        As in ``frequency_response.csv`` and ``spectrum.csv``.
    trusted : sequence of float
        Frequencies of the modes that are marked, in Hz.
    unit : str
        Unit of the gain, "" when not stated.
    axes : matplotlib.axes.Axes, optional
        Where it is drawn; on a new figure by default.
    """
    (axes,) = SUMMARY.panels(axes)
    for place, frequency in enumerate(trusted):
        axes.axvline(
            frequency,
            color=MODEL,
            linewidth=0.8,
            linestyle=(0, (1.2, 1.6)),
            label="trusted modes" if place == 0 else None,
        )
    response, label = plant_or_noise_filter(response)
    estimate = None if label == NOISE_FILTER else with_positive_frequency(spectrum)
    draw_gain(axes, response, estimate, unit, label)
    axes.set_xlabel("Frequency (Hz)")
    axes.set_xlim(0, float(response["frequency_hz"].max()))
    return figure_of(axes)
