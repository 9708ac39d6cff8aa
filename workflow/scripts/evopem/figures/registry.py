"""Every figure of the report: its name, caption, data, and how it is drawn from the results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.config.structures import plant_order
from evopem.figures.convergence import draw_convergence
from evopem.figures.figure_data import (
    convergence_table,
    delay_table,
    frequency_response_table,
    horizons_table,
    phases_table,
    record_table,
    residuals_table,
    roots_table,
    simulation_table,
    spectrum_table,
    stabilization_table,
)
from evopem.figures.frequency_domain import draw_frequency_response, draw_spectrum
from evopem.figures.horizons import draw_horizons
from evopem.figures.order_criteria import draw_delay, draw_phases, draw_structures
from evopem.figures.pole_zero_map import draw_poles_zeros
from evopem.figures.residual_correlation import draw_residuals
from evopem.figures.signal_labels import prepared_output_name, prepared_output_unit
from evopem.figures.stabilization_diagram import draw_stabilization
from evopem.figures.style import ratio_unit, save_svg, with_unit
from evopem.figures.time_domain import draw_record, draw_simulation
from evopem.results.dataset import DatasetResults
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_FILES = DatasetFiles(".")


@dataclass(frozen=True)
class ReportFigure:
    """One figure of the report.

    Attributes
    ----------
    name : str
        One of :data:`evopem.results.layout.FIGURES`.
    caption : str
        What is drawn, and the corresponding figure of the chapter.
    data : tuple of str
        The files of the results that hold what is drawn.
    draw : callable
        Draws the figure from the results.
    table : callable
        Takes what is drawn from the results, as one table.
    """

    name: str
    caption: str
    data: tuple[str, ...]
    draw: Callable[[DatasetResults], Figure]
    table: Callable[[DatasetResults], pd.DataFrame]

    @property
    def data_files(self) -> list[str]:
        """Names of the files of `data` in the data set's folder."""
        return [Path(file).as_posix() for file in self.data]


def _output_unit(results: DatasetResults) -> str:
    return prepared_output_unit(results.model.transforms, results.recording.output_unit)


def _spectrum(results: DatasetResults) -> Figure:
    peaks = results.spectrum_summary.peaks
    return draw_spectrum(results.spectrum, peaks, _output_unit(results), results.truth)


def _frequency_response(results: DatasetResults) -> Figure:
    unit = ratio_unit(_output_unit(results), results.recording.input_unit)
    return draw_frequency_response(
        results.frequency_response, results.spectrum, unit, results.truth
    )


def _residuals(results: DatasetResults) -> Figure:
    tables = results.validation_tables
    return draw_residuals(tables.residual_autocorrelation, tables.cross_correlation)


def _simulation(results: DatasetResults) -> Figure:
    name = prepared_output_name(results.model.transforms, results.recording.output_name)
    return draw_simulation(
        results.validation_tables.simulation,
        results.model.sampling_rate,
        with_unit(name, _output_unit(results)),
    )


def _stabilization(results: DatasetResults) -> Figure:
    return draw_stabilization(
        stabilization_table(results),
        results.model.sampling_rate,
        results.spectrum,
        getattr(results.models_of_orders.orders, plant_order(results.model.orders.structure)),
        results.truth,
        plant_order(results.model.orders.structure),
    )


def _structure(results: DatasetResults) -> str:
    return results.model.orders.structure


def _phases(results: DatasetResults) -> Figure:
    if results.decisions is not None:
        return draw_structures(results.candidates)
    return draw_phases(results.candidates, _structure(results))


REPORT_FIGURES = (
    ReportFigure(
        "record",
        "Input and output as recorded, and as used after the transforms (chapter figure 3).",
        (_FILES.recording, _FILES.prepared),
        lambda results: draw_record(results.recording, results.prepared),
        record_table,
    ),
    ReportFigure(
        "spectrum",
        "Multitaper spectrum of the transformed output with 95 % band and peaks"
        " (chapter figure 4).",
        (_FILES.spectrum,),
        _spectrum,
        spectrum_table,
    ),
    ReportFigure(
        "delay",
        "RSS and BIC against the order for each delay (chapter figure 5).",
        (_FILES.candidates,),
        lambda results: draw_delay(results.candidates, _structure(results)),
        delay_table,
    ),
    ReportFigure(
        "phases",
        "RSS and BIC of the candidates of the order search, with the selected orders marked.",
        (_FILES.candidates,),
        _phases,
        phases_table,
    ),
    ReportFigure(
        "poles_zeros",
        "Poles and zeros in the unit circle with 95 % confidence ellipses, and the modes.",
        (_FILES.model,),
        lambda results: draw_poles_zeros(results.model.model, results.truth),
        roots_table,
    ),
    ReportFigure(
        "frequency_response",
        "Frequency response of G with 95 % band, and the multitaper estimate with its coherence"
        " (chapter figure 7).",
        (_FILES.frequency_response, _FILES.spectrum),
        _frequency_response,
        frequency_response_table,
    ),
    ReportFigure(
        "residuals",
        "Autocorrelation of the residuals and their cross-correlation with the input, with 95 %"
        " bounds (chapter figure 6).",
        (_FILES.residual_autocorrelation, _FILES.cross_correlation),
        _residuals,
        residuals_table,
    ),
    ReportFigure(
        "simulation",
        "One-second simulation on the validation data and its error (chapter figure 8).",
        (_FILES.simulation,),
        _simulation,
        simulation_table,
    ),
    ReportFigure(
        "horizons",
        "Error of the prediction of the validation samples against its horizon, and the error of"
        " the simulation.",
        (_FILES.horizons,),
        lambda results: draw_horizons(
            results.validation_tables.horizons, results.validation.simulation_error_percent
        ),
        horizons_table,
    ),
    ReportFigure(
        "stabilization",
        "Stabilization diagram: the poles of every joint order, with the spectrum of the output.",
        (_FILES.phases,),
        _stabilization,
        stabilization_table,
    ),
    ReportFigure(
        "convergence",
        "Convergence of the search for the selected model: the lowest objective after each"
        " generation and after each final descent.",
        (_FILES.phases,),
        lambda results: draw_convergence(results.selected.diagnostics.convergence),
        convergence_table,
    ),
)
"""The figures in the order of :data:`evopem.results.layout.FIGURES`."""


def draw_all(results: DatasetResults, directory: Path) -> list[Path]:
    """Draw every figure of one data set.

    Parameters
    ----------
    results : DatasetResults
    directory : Path
        Folder of the SVG files, which are named after the figures.

    Returns
    -------
    list of Path
        The files, in the order of the report.
    """
    files = []
    for figure in REPORT_FIGURES:
        file = directory / f"{figure.name}.svg"
        save_svg(figure.draw(results), file)
        files.append(file)
    return files
