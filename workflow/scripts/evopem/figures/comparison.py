"""Figures of several models side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from evopem.figures.frequency_domain import (
    BINS,
    plant_or_noise_filter,
    unwrapped_gaps,
    with_positive_frequency,
)
from evopem.figures.panels import gain_unit, output_label
from evopem.figures.style import (
    FAMILY,
    FAMILY_LINES,
    FAMILY_MARKERS,
    INK,
    Grid,
    decimate,
    extremes,
    figure_of,
    logarithmic,
    say_nothing_to_draw,
    styled,
    with_unit,
)
from evopem.figures.summary import shown_samples, simulated_or_predicted
from evopem.figures.time_domain import folded

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from evopem.results.comparison import Comparison

RESPONSES = Grid(height=4.6, rows=2, sharex=True, height_ratios=(1.7, 1.1))
SIMULATIONS = Grid(height=3.3)
MODES = Grid(height=3.3)


def simulated_column(number: int) -> str:
    """Column of the simulation by a model, counted from 1."""
    return f"simulated_{number}"


def compared_responses_table(comparison: Comparison) -> pd.DataFrame:
    """Frequency response of every model, counted from 1, thinned to the extremes of its gain."""
    columns = ["frequency_hz", "gain", "gain_lower", "gain_upper", "phase_deg"]
    tables = []
    for number, results in enumerate(comparison.results, start=1):
        response = with_positive_frequency(plant_or_noise_filter(results.frequency_response)[0])
        shown = response.iloc[extremes(response["gain"], BINS)]
        tables.append(shown[columns].assign(model=number))
    return pd.concat(tables, ignore_index=True)[["model", *columns]]


def compared_simulations_table(comparison: Comparison) -> pd.DataFrame:
    """Validation samples, and their simulation by every model; without an input, the prediction.

    Of models that were validated on the same samples.
    """
    tables = [each.validation_tables.simulation for each in comparison.results]
    computed = {
        simulated_column(number): table[simulated_or_predicted(table)]
        for number, table in enumerate(tables, start=1)
    }
    together = tables[0][["time_s", "output"]].assign(**computed)
    return together[together.notna().all(axis="columns")]


@styled
def draw_compared_responses(comparison: Comparison, axes: Sequence[Axes] | None = None) -> Figure:
    """Gain and phase of every model, with the 95 % bands of the gains.

    Parameters
    ----------
    comparison : Comparison
    axes : sequence of two matplotlib.axes.Axes, optional
        Where gain and phase are drawn; on a new figure by default.
    """
    gain, phase = RESPONSES.panels(axes)
    table = compared_responses_table(comparison)
    for number, (label, colour, line) in enumerate(
        zip(comparison.labels, FAMILY, FAMILY_LINES, strict=False), start=1
    ):
        shown = table[table["model"] == number]
        if shown["gain_lower"].notna().any():
            floor = 1e-3 * float(shown["gain"].min())
            gain.fill_between(
                shown["frequency_hz"],
                shown["gain_lower"].clip(lower=floor),
                shown["gain_upper"],
                color=colour,
                alpha=0.18,
                linewidth=0,
            )
        gain.plot(shown["frequency_hz"], shown["gain"], color=colour, linestyle=line, label=label)
        phase.plot(
            *unwrapped_gaps(shown["frequency_hz"], shown["phase_deg"]),
            color=colour,
            linestyle=line,
        )
    gains = table["gain"][table["gain"] > 0]
    if len(gains):
        gain.set_ylim(float(gains.min()) / 4, float(gains.max()) * 4)
    logarithmic(gain)
    units = {gain_unit(results) for results in comparison.results}
    gain.set_ylabel(with_unit("Gain", units.pop() if len(units) == 1 else ""))
    _legend(gain)
    phase.set_ylabel("Phase (°)")
    phase.set_ylim(-190, 190)
    phase.set_yticks([-180, -90, 0, 90, 180])
    phase.set_xlabel("Frequency (Hz)")
    phase.set_xlim(0, max(each.model.sampling_rate for each in comparison.results) / 2)
    return figure_of(gain)


@styled
def draw_compared_simulations(comparison: Comparison, axes: Axes | None = None) -> Figure:
    """First validation samples, measured and simulated by every model.

    Where the models were validated on different samples there is nothing to lay over each other.

    Parameters
    ----------
    comparison : Comparison
    axes : matplotlib.axes.Axes, optional
        Where it is drawn; on a new figure by default.
    """
    (axes,) = SIMULATIONS.panels(axes)
    if not comparison.has_same_validation:
        say_nothing_to_draw(axes, "The models were validated on different samples.")
        return figure_of(axes)
    first = comparison.results[0]
    kept = shown_samples(first.model.modes, first.model.sampling_rate)
    shown = compared_simulations_table(comparison).iloc[:kept]
    axes.plot(shown["time_s"], shown["output"], color=INK, linewidth=1.6, label="measured")
    for number, (label, colour, line) in enumerate(
        zip(comparison.labels, FAMILY, FAMILY_LINES, strict=False), start=1
    ):
        x, y = decimate(shown["time_s"], shown[simulated_column(number)])
        axes.plot(x, y, color=colour, linestyle=line, linewidth=1.0, label=label)
    axes.set_xlabel("Time from the first validation sample (s)")
    axes.set_ylabel(folded(output_label(first)))
    axes.margins(x=0.01)
    _legend(axes)
    return figure_of(axes)


@styled
def draw_compared_modes(comparison: Comparison, axes: Axes | None = None) -> Figure:
    """Damping ratio over natural frequency with 95 % intervals; those not to be trusted are open.

    Parameters
    ----------
    comparison : Comparison
    axes : matplotlib.axes.Axes, optional
        Where it is drawn; on a new figure by default.
    """
    (axes,) = MODES.panels(axes)
    table = comparison.mode_table
    if table.empty:
        say_nothing_to_draw(axes, "No model has an oscillating mode.")
        return figure_of(axes)
    for label, colour, marker in zip(comparison.labels, FAMILY, FAMILY_MARKERS, strict=False):
        rows = table[table["data set"] == label]
        trusted, doubted = rows[rows["trusted"]], rows[~rows["trusted"]]
        axes.errorbar(
            trusted["frequency_hz"],
            trusted["damping_percent"],
            xerr=1.96 * trusted["frequency_se_hz"],
            yerr=1.96 * trusted["damping_se_percent"],
            fmt=marker,
            color=colour,
            markersize=5,
            capsize=2.0,
            elinewidth=0.8,
            label=label,
        )
        axes.plot(
            doubted["frequency_hz"],
            doubted["damping_percent"],
            marker,
            color=colour,
            markerfacecolor="none",
            markersize=5,
        )
    axes.set_xlabel("Natural frequency (Hz)")
    axes.set_ylabel("Damping ratio (%)")
    damping = table["damping_percent"]
    axes.set_ylim(min(0.0, 1.2 * float(damping.min())), 1.3 * max(float(damping.max()), 1e-6))
    axes.set_xlim(0, max(each.model.sampling_rate for each in comparison.results) / 2)
    _legend(axes)
    return figure_of(axes)


def _legend(axes: Axes) -> None:
    """A legend above the panel in as many columns as the labels leave room for."""
    labels = axes.get_legend_handles_labels()[1]
    columns = max(1, min(4, 90 // max(map(len, labels), default=1)))
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.1)
