"""Every figure of the report: its file, title, data, and how it is drawn from the results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.figures.figure_data import (
    convergence_table,
    delay_table,
    frequency_response_table,
    phases_table,
    record_table,
    residuals_table,
    roots_table,
    simulation_table,
    spectrum_table,
    stabilization_table,
)
from evopem.figures.frequency_domain import draw_frequency_response, draw_spectrum
from evopem.figures.labels import prepared_output_name, prepared_output_unit
from evopem.figures.order_selection import draw_convergence, draw_delay, draw_phases
from evopem.figures.pole_zero_map import draw_poles_zeros, draw_stabilization
from evopem.figures.residuals import draw_residuals
from evopem.figures.style import ratio_unit, save_svg, with_unit
from evopem.figures.time_domain import draw_record, draw_simulation
from evopem.results.dataset import Results, read_results

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FigureEntry:
    """One figure of the report.

    Attributes
    ----------
    name : str
        Stem of its file, ``figures/<name>.svg``.
    caption : str
        What is drawn, and the figure of the chapter it answers to.
    data : tuple of str
        Result files that hold what is drawn.
    draw : callable
        From the results to a matplotlib figure.
    table : callable
        From the results to the numbers that are drawn.
    """

    name: str
    caption: str
    data: tuple[str, ...]
    draw: Callable[[Results], Figure]
    table: Callable[[Results], pd.DataFrame]

    @property
    def file(self) -> str:
        """File name relative to the data set's directory."""
        return f"figures/{self.name}.svg"


def _output_unit(results: Results) -> str:
    return prepared_output_unit(results.transforms, results.recording.output_unit)


def _gain_unit(results: Results) -> str:
    return ratio_unit(_output_unit(results), results.recording.input_unit)


def _simulation_label(results: Results) -> str:
    name = prepared_output_name(results.transforms, results.recording.output_name)
    return with_unit(name, _output_unit(results))


def _stabilization(results: Results) -> Figure:
    selected = results.phases.get("common", {}).get("selected") or {}
    return draw_stabilization(
        stabilization_table(results),
        float(results.model["sampling_rate"]),
        results.spectrum,
        selected.get("na"),
        results.truth,
    )


FIGURES = (
    FigureEntry(
        "record",
        "Input and output as recorded, and as used after the transforms (chapter figure 3).",
        ("recording.npz", "prepared.npz"),
        lambda results: draw_record(results.recording, results.prepared),
        record_table,
    ),
    FigureEntry(
        "spectrum",
        "Multitaper spectrum of the transformed output with 95 % band and peaks"
        " (chapter figure 4).",
        ("spectrum.csv",),
        lambda results: draw_spectrum(
            results.spectrum, results.spectrum_summary, _output_unit(results), results.truth
        ),
        spectrum_table,
    ),
    FigureEntry(
        "delay",
        "RSS and BIC against the order for each delay (chapter figure 5).",
        ("candidates.csv",),
        lambda results: draw_delay(results.candidates),
        delay_table,
    ),
    FigureEntry(
        "phases",
        "RSS and BIC of the three phases, the choice marked.",
        ("candidates.csv",),
        lambda results: draw_phases(results.candidates),
        phases_table,
    ),
    FigureEntry(
        "poles_zeros",
        "Poles and zeros in the unit circle with 95 % confidence ellipses, and the modes.",
        ("model.json",),
        lambda results: draw_poles_zeros(results.model, results.truth),
        roots_table,
    ),
    FigureEntry(
        "frequency_response",
        "Frequency response of G with 95 % band over the multitaper estimate and its coherence"
        " (chapter figure 7).",
        ("frequency_response.csv", "spectrum.csv"),
        lambda results: draw_frequency_response(
            results.frequency_response, results.spectrum, _gain_unit(results), results.truth
        ),
        frequency_response_table,
    ),
    FigureEntry(
        "residuals",
        "Autocorrelation of the residuals and their cross-correlation with the input, with 95 %"
        " bounds (chapter figure 6).",
        ("residual_autocorrelation.csv", "cross_correlation.csv"),
        lambda results: draw_residuals(results.residual_autocorrelation, results.cross_correlation),
        residuals_table,
    ),
    FigureEntry(
        "simulation",
        "One-second simulation on the validation data and its error (chapter figure 8).",
        ("simulation.csv",),
        lambda results: draw_simulation(
            results.simulation, float(results.model["sampling_rate"]), _simulation_label(results)
        ),
        simulation_table,
    ),
    FigureEntry(
        "stabilization",
        "Stabilization diagram: the poles of every common order, with the spectrum behind.",
        ("phases/common.json",),
        _stabilization,
        stabilization_table,
    ),
    FigureEntry(
        "convergence",
        "Convergence of the search for the chosen model: the best objective after each generation"
        " and each final polish.",
        ("phases/b.json",),
        lambda results: draw_convergence(results.chosen_candidate()),
        convergence_table,
    ),
)
FIGURE_NAMES = tuple(entry.name for entry in FIGURES)


def draw_all(paths: Mapping[str, Path], directory: Path) -> list[Path]:
    """Draw every figure of one data set.

    Parameters
    ----------
    paths : mapping of str to Path
        Result files, as for `read_results`.
    directory : Path
        Where the SVG files go.

    Returns
    -------
    list of Path
        The files, in the order of the report.
    """
    results = read_results(paths)
    files = []
    for entry in FIGURES:
        file = directory / f"{entry.name}.svg"
        save_svg(entry.draw(results), file)
        files.append(file)
    return files
