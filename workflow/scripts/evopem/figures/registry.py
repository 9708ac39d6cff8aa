"""Every figure of the report: its name, caption, data, and how it is drawn from the results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.config.structures import plant_order
from evopem.figures import panels
from evopem.figures.convergence import draw_convergence
from evopem.figures.figure_data import (
    convergence_table,
    delay_table,
    frequency_response_table,
    gain_table,
    horizons_table,
    measured_and_simulated_table,
    nyquist_table,
    phases_table,
    record_table,
    residual_spectrum_table,
    residuals_table,
    roots_table,
    simulation_as_recorded_table,
    simulation_table,
    spectrum_table,
    stabilization_table,
)
from evopem.figures.frequency_domain import (
    draw_frequency_response,
    draw_nyquist,
    draw_residual_spectrum,
    draw_spectrum,
)
from evopem.figures.horizons import draw_horizons
from evopem.figures.order_criteria import draw_delay, draw_phases, draw_structures
from evopem.figures.panels import Panel
from evopem.figures.pole_zero_map import draw_poles_zeros
from evopem.figures.residual_correlation import draw_residuals
from evopem.figures.stabilization_diagram import draw_stabilization
from evopem.figures.style import save_svg, svg_text, with_unit
from evopem.figures.summary import draw_gain_and_data, draw_measured_and_simulated
from evopem.figures.time_domain import draw_record, draw_simulation, draw_simulation_as_recorded
from evopem.figures.time_responses import draw_step_and_impulse, responses_of, settling_part
from evopem.results.dataset import DatasetResults
from evopem.results.layout import DatasetFiles

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_FILES = DatasetFiles(".")


def _no_panels(_: DatasetResults) -> list[Panel]:
    return []


def _always(_: DatasetResults) -> bool:
    return True


def _has_input(results: DatasetResults) -> bool:
    return results.model.model.has_input


@dataclass(frozen=True)
class ReportFigure:
    """One figure of the report.

    Attributes
    ----------
    name : str
        One of :data:`evopem.results.layout.FIGURES`.
    caption : str
        What is drawn.
    data : tuple of str
        The files of the results that hold what is drawn.
    draw : callable
        Draws the figure from the results.
    table : callable
        Takes what is drawn from the results, as one table.
    panels : callable
        What the page draws from this table for a reader to zoom; empty where it does not.
    applies : callable
        Whether the page shows the figure.
    without_input : str
        Caption for a model without input, where it is another one.
    """

    name: str
    caption: str
    data: tuple[str, ...]
    draw: Callable[[DatasetResults], Figure]
    table: Callable[[DatasetResults], pd.DataFrame]
    panels: Callable[[DatasetResults], list[Panel]] = _no_panels
    applies: Callable[[DatasetResults], bool] = _always
    without_input: str = ""

    @property
    def data_files(self) -> list[str]:
        """Names of the files of `data` in the data set's folder."""
        return [Path(file).as_posix() for file in self.data]

    def caption_of(self, results: DatasetResults) -> str:
        """What is drawn of these results."""
        return self.caption if _has_input(results) else self.without_input or self.caption


def _measured_and_simulated(results: DatasetResults) -> Figure:
    return draw_measured_and_simulated(
        results.validation_tables.simulation,
        results.model.modes,
        results.model.sampling_rate,
        panels.output_label(results),
    )


def _trusted_frequencies(results: DatasetResults) -> list[float]:
    return [each.mode.frequency_hz for each in results.trusted_modes]


def _gain_and_data(results: DatasetResults) -> Figure:
    return draw_gain_and_data(
        results.frequency_response,
        results.spectrum,
        _trusted_frequencies(results),
        panels.gain_unit(results),
    )


def _spectrum(results: DatasetResults) -> Figure:
    peaks = results.spectrum_summary.peaks
    return draw_spectrum(results.spectrum, peaks, panels.output_unit(results), results.truth)


def _frequency_response(results: DatasetResults) -> Figure:
    return draw_frequency_response(
        results.frequency_response, results.spectrum, panels.gain_unit(results), results.truth
    )


def _residuals(results: DatasetResults) -> Figure:
    tables = results.validation_tables
    return draw_residuals(tables.residual_autocorrelation, tables.cross_correlation)


def _simulation(results: DatasetResults) -> Figure:
    return draw_simulation(
        results.validation_tables.simulation,
        results.model.sampling_rate,
        panels.output_label(results),
    )


def _simulation_as_recorded(results: DatasetResults) -> Figure:
    recording = results.recording
    return draw_simulation_as_recorded(
        results.validation_tables.simulation,
        with_unit(recording.output_name, recording.output_unit),
    )


def _output_is_transformed(results: DatasetResults) -> bool:
    return results.model.transforms.changes_output


def _has_poles_over_orders(results: DatasetResults) -> bool:
    if results.decisions is not None:
        return results.model.orders.structure != "fir"
    return "joint" in results.phases


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
        "measured_and_simulated",
        "Validation samples from the first on, less the level of the estimation samples. The"
        " simulation uses the input alone.",
        (_FILES.simulation,),
        _measured_and_simulated,
        measured_and_simulated_table,
        panels.measured_and_simulated,
        without_input="Validation samples from the first on, less the level of the estimation"
        " samples. The prediction knows the output before.",
    ),
    ReportFigure(
        "gain",
        "Gain with 95 % band, and the multitaper estimate from the data; dotted: trusted modes.",
        (_FILES.frequency_response, _FILES.spectrum),
        _gain_and_data,
        gain_table,
        lambda results: panels.gain(results, _trusted_frequencies(results)),
        without_input="Gain of the noise filter with 95 % band; dotted: trusted modes.",
    ),
    ReportFigure(
        "poles_zeros",
        "Poles and zeros with 95 % confidence ellipses, and the modes.",
        (_FILES.model,),
        lambda results: draw_poles_zeros(results.model.model, results.truth),
        roots_table,
    ),
    ReportFigure(
        "stabilization",
        "The poles of every joint order, with the spectrum of the output.",
        (_FILES.phase_folder,),
        _stabilization,
        stabilization_table,
        panels.stabilization,
        _has_poles_over_orders,
    ),
    ReportFigure(
        "frequency_response",
        "Model G with 95 % band; multitaper estimate with its coherence.",
        (_FILES.frequency_response, _FILES.spectrum),
        _frequency_response,
        frequency_response_table,
        panels.frequency_response,
        without_input="Noise filter H with 95 % band.",
    ),
    ReportFigure(
        "step_and_impulse",
        "Responses to a unit step and to one sample of 1, with 95 % bands.",
        (_FILES.time_response,),
        lambda results: draw_step_and_impulse(
            settling_part(results.time_response),
            responses_of(results.time_response),
            panels.gain_unit(results),
        ),
        lambda results: settling_part(results.time_response),
        panels.step_and_impulse,
        without_input="Response of the noise filter to one sample of 1, with 95 % band.",
    ),
    ReportFigure(
        "nyquist",
        "G in the complex plane over positive frequencies, and the multitaper estimate.",
        (_FILES.frequency_response, _FILES.spectrum),
        lambda results: draw_nyquist(
            results.frequency_response, results.spectrum, panels.gain_unit(results)
        ),
        nyquist_table,
        applies=_has_input,
    ),
    ReportFigure(
        "simulation",
        "Validation samples, simulated and predicted, and the errors.",
        (_FILES.simulation,),
        _simulation,
        simulation_table,
        panels.simulation,
        without_input="Validation samples, predicted one step ahead, and the errors.",
    ),
    ReportFigure(
        "simulation_as_recorded",
        "Validation samples with all transforms inverted.",
        (_FILES.simulation,),
        _simulation_as_recorded,
        simulation_as_recorded_table,
        panels.simulation_as_recorded,
        _output_is_transformed,
    ),
    ReportFigure(
        "horizons",
        "Error of the prediction of the validation samples over its horizon, and of the"
        " simulation.",
        (_FILES.horizons,),
        lambda results: draw_horizons(
            results.validation_tables.horizons, results.validation.simulation_error_percent
        ),
        horizons_table,
        without_input="Error of the prediction of the validation samples over its horizon.",
    ),
    ReportFigure(
        "residuals",
        "Correlations of the residuals with themselves and with the input, with 95 % bounds. At"
        " positive lags the residual follows the input.",
        (_FILES.residual_autocorrelation, _FILES.cross_correlation),
        _residuals,
        residuals_table,
        panels.residuals,
        without_input="Correlations of the residuals with themselves, with 95 % bounds.",
    ),
    ReportFigure(
        "residual_spectrum",
        "One-step errors on the validation samples; flat if they are white.",
        (_FILES.simulation,),
        lambda results: draw_residual_spectrum(
            residual_spectrum_table(results), panels.output_unit(results)
        ),
        residual_spectrum_table,
        panels.residual_spectrum,
    ),
    ReportFigure(
        "record",
        "Input and output as recorded and as used.",
        (_FILES.recording, _FILES.prepared),
        lambda results: draw_record(results.recording, results.prepared),
        record_table,
        panels.record,
        without_input="Output as recorded and as used.",
    ),
    ReportFigure(
        "spectrum",
        "Multitaper estimate with 95 % band and peaks.",
        (_FILES.spectrum,),
        _spectrum,
        spectrum_table,
        panels.spectrum,
    ),
    ReportFigure(
        "delay",
        "RSS and BIC against the order for each delay.",
        (_FILES.candidates,),
        lambda results: draw_delay(results.candidates, _structure(results)),
        delay_table,
        applies=lambda results: "delay" in results.phases,
    ),
    ReportFigure(
        "phases",
        "RSS and BIC of the candidates of the order search; the selected orders are marked.",
        (_FILES.candidates,),
        _phases,
        phases_table,
    ),
    ReportFigure(
        "convergence",
        "Lowest objective after each generation and after each final descent.",
        (_FILES.phase_folder,),
        lambda results: draw_convergence(results.selected.diagnostics.convergence),
        convergence_table,
        panels.convergence,
    ),
)
"""The figures in the order of :data:`evopem.results.layout.FIGURES`."""


def svg_texts(results: DatasetResults) -> dict[str, str]:
    """Every figure of one data set as SVG, by name."""
    return {figure.name: svg_text(figure.draw(results)) for figure in REPORT_FIGURES}


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
