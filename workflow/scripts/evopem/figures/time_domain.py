"""Figures over time: the recording before and after the transforms, and the simulation."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.figures.signal_labels import (
    prepared_input_name,
    prepared_output_name,
    prepared_output_unit,
)
from evopem.figures.style import (
    ERROR,
    INK,
    MODEL,
    MUTED,
    decimate,
    new_figure,
    styled,
    with_unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from evopem.signals.preparation import PreparedData
    from evopem.signals.recording import Recording


LineStyle = str | tuple[int, tuple[float, ...]]
DASHED: LineStyle = (0, (4, 2))


@styled
def draw_record(recording: Recording, prepared: PreparedData) -> Figure:
    """Input and output before and after the transforms (chapter figure 3)."""
    transforms = prepared.transforms
    figure = new_figure(4.4)
    rows = 2 if recording.has_input else 1
    axes = figure.subplots(rows, 2, sharex="col", squeeze=False)
    time = np.arange(recording.output.size) / recording.sampling_rate
    before = (
        (recording.input, with_unit(recording.input_name, recording.input_unit)),
        (recording.output, with_unit(recording.output_name, recording.output_unit)),
    )
    for row, (values, label) in enumerate(before[-rows:]):
        x, y = decimate(time, values)
        axes[row, 0].plot(x, y, color=INK, linewidth=0.6)
        axes[row, 0].set_ylabel(folded(label))
    axes[0, 0].set_title("As recorded")
    axes[-1, 0].set_xlabel("Time (s)")
    estimation, validation = prepared.estimation, prepared.validation
    unit = prepared_output_unit(transforms, estimation.output_unit)
    after = (
        (
            estimation.input,
            validation.input,
            with_unit(
                prepared_input_name(transforms, estimation.input_name), estimation.input_unit
            ),
        ),
        (
            estimation.output,
            validation.output,
            with_unit(prepared_output_name(transforms, estimation.output_name), unit),
        ),
    )
    for row, (estimated, held_out, label) in enumerate(after[-rows:]):
        _estimation_and_validation(axes[row, 1], estimated, held_out, estimation.sampling_rate)
        axes[row, 1].set_ylabel(folded(label))
    axes[0, 1].set_title("As used")
    axes[-1, 1].set_xlabel(
        "Time (s)" if prepared.contiguous else "Time (s); the validation recording follows"
    )
    axes[0, 1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
    return figure


def _estimation_and_validation(
    axes: Axes, estimation: np.ndarray, validation: np.ndarray, sampling_rate: float
) -> None:
    time = np.arange(estimation.size + validation.size) / sampling_rate
    x, y = decimate(time[: estimation.size], estimation)
    axes.plot(x, y, color=INK, linewidth=0.6, label="estimation")
    x, y = decimate(time[estimation.size :], validation)
    axes.plot(x, y, color=MODEL, linewidth=0.6, label="validation")
    if validation.size:
        axes.axvline(time[estimation.size], color=ERROR, linewidth=0.8, linestyle=(0, (3, 2)))


def folded(label: str, width: int = 26) -> str:
    """Break a long label into lines."""
    return "\n".join(textwrap.wrap(label, width, break_on_hyphens=False)[:3]) or label


@styled
def draw_simulation(simulation: pd.DataFrame, sampling_rate: float, label: str) -> Figure:
    """One second of validation data, measured and simulated, and the errors (chapter figure 8).

    The second starts at the first scored sample. At least 60 samples are shown.

    Parameters
    ----------
    simulation : pandas.DataFrame
        As in ``simulation.csv``.
    sampling_rate : float
        Hz.
    label : str
        Name of the prepared output with its unit.
    """
    figure = new_figure(5.4)
    second, error, whole = figure.subplots(3, 1, height_ratios=(1.35, 1.0, 1.0))
    # A model without input has no simulation.
    simulated = bool(simulation["simulated"].notna().any())
    scored = simulation[simulation["predicted"].notna()]
    if simulated:
        scored = scored[scored["simulated"].notna()]
    shown = scored.iloc[: max(round(sampling_rate) + 1, 60)]
    _lines(
        second,
        shown,
        ("output", INK, "-", "measured"),
        ("simulated", ERROR, DASHED, "simulated")
        if simulated
        else ("predicted", MODEL, DASHED, "predicted one step ahead"),
    )
    span = shown["time_s"].iloc[-1] - shown["time_s"].iloc[0] if len(shown) else 0.0
    second.set_title(f"The first {span:.3g} s of validation data")
    second.set_ylabel(folded(label))
    legend_above(second)
    second.tick_params(labelbottom=False)
    error.sharex(second)
    _lines(
        error,
        shown,
        *([("simulation_error", ERROR, DASHED, "of simulation")] if simulated else []),
        ("prediction_error", MODEL, "-", "of one-step prediction"),
    )
    error.set_title("Errors in that time")
    error.set_ylabel("Error")
    error.set_xlabel("Time from the first validation sample (s)")
    legend_above(error)
    _lines(
        whole,
        simulation,
        ("output", MUTED, "-", "measured"),
        ("simulation_error", ERROR, "-", "error of simulation")
        if simulated
        else ("prediction_error", ERROR, "-", "error of one-step prediction"),
        width=0.6,
    )
    whole.set_title("All validation data")
    whole.set_xlabel("Time from the first validation sample (s)")
    whole.set_ylabel(folded(label))
    legend_above(whole)
    return figure


def _lines(
    axes: Axes, table: pd.DataFrame, *lines: tuple[str, str, LineStyle, str], width: float = 1.2
) -> None:
    """Draw columns over time, each given as column, colour, line style and label."""
    for column, colour, style, label in lines:
        x, y = decimate(table["time_s"], table[column])
        axes.plot(x, y, color=colour, linestyle=style, linewidth=width, label=label)


@styled
def draw_simulation_as_recorded(simulation: pd.DataFrame, label: str) -> Figure:
    """Validation data in the units of the recording: measured, predicted and simulated.

    Parameters
    ----------
    simulation : pandas.DataFrame
        As in ``simulation.csv``.
    label : str
        Name of the recorded output with its unit.
    """
    figure = new_figure(2.9)
    axes = figure.subplots()
    _lines(
        axes,
        simulation,
        ("recorded_output", INK, "-", "measured"),
        ("recorded_predicted", MODEL, DASHED, "predicted one step ahead"),
        ("recorded_simulated", ERROR, DASHED, "simulated"),
    )
    axes.set_xlabel("Time from the first validation sample (s)")
    axes.set_ylabel(folded(label))
    axes.margins(x=0.01)
    legend_above(axes)
    return figure


def legend_above(axes: Axes) -> None:
    """Put the legend above the panel, where it hides no data."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1)
