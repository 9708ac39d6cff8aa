"""What an identification found, as an object to look at, plot, compare and keep."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import pandas as pd

from evopem.automatic.decision import Decision
from evopem.config.settings import DatasetSettings, RecordedSource
from evopem.config.structures import plant_order
from evopem.errors import InputError
from evopem.figures import panels
from evopem.figures.figure_data import residual_spectrum_table, stabilization_table
from evopem.figures.frequency_domain import (
    FREQUENCY_RESPONSE,
    NYQUIST,
    RESIDUAL_SPECTRUM,
    SPECTRUM,
    draw_frequency_response,
    draw_nyquist,
    draw_residual_spectrum,
    draw_spectrum,
)
from evopem.figures.horizons import HORIZONS, draw_horizons
from evopem.figures.pole_zero_map import POLES_ZEROS, draw_poles_zeros
from evopem.figures.residual_correlation import RESIDUALS, draw_residuals
from evopem.figures.stabilization_diagram import STABILIZATION, draw_stabilization
from evopem.figures.summary import SUMMARY, draw_gain_and_data, draw_measured_and_simulated
from evopem.figures.time_responses import (
    OF_NOISE,
    OF_PLANT,
    RESPONSE,
    draw_response,
    settling_part,
)
from evopem.files.atomic import write_text
from evopem.models.polynomial import PolynomialModel
from evopem.notebook.comparison import ModelComparison
from evopem.notebook.drawing import pyplot_panels
from evopem.notebook.summary import html_summary
from evopem.pipeline.packages import FOR_FIGURES, FOR_REPORT, check_packages
from evopem.report.results_text import results_text
from evopem.report.sentences.about_verdict import verdict
from evopem.results.comparison import Comparison
from evopem.results.dataset import DatasetResults, read_dataset_results
from evopem.results.layout import DatasetFiles
from evopem.validation.checks import Check
from evopem.validation.validation import Validation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from evopem.figures.style import Grid


@dataclass(frozen=True, eq=False, repr=False)
class IdentificationResults:
    """What an identification found; in a notebook it shows verdict, modes and errors.

    Every ``plot_…`` takes the axes to draw on, by default new ones, and returns them.

    Attributes
    ----------
    files : DatasetFiles
        Where the files of the results lie.
    results : DatasetResults
        All of them: settings, prepared samples, order search, model, validation and tables.
    """

    files: DatasetFiles
    results: DatasetResults
    _folder: TemporaryDirectory[str] | None = None

    @classmethod
    def of(
        cls,
        files: DatasetFiles,
        settings: DatasetSettings,
        folder: TemporaryDirectory[str] | None = None,
    ) -> IdentificationResults:
        """Read the results of a data set.

        Parameters
        ----------
        files : DatasetFiles
        settings : DatasetSettings
        folder : TemporaryDirectory, optional
            Deleted with the object.

        Raises
        ------
        InputError
            When a file is missing or damaged.
        """
        return cls(files, read_dataset_results(files, settings), folder)

    @property
    def name(self) -> str:
        """Name of the data set."""
        return self.results.name

    @property
    def model(self) -> PolynomialModel:
        """The model: it simulates, predicts, and gives its modes and frequency response."""
        return self.results.model.model

    @property
    def validation(self) -> Validation:
        """Errors and residual tests."""
        return self.results.validation

    @property
    def simulation_error_percent(self) -> float:
        """Error of the simulation of validation samples, percent of their deviation."""
        return self.validation.simulation_error_percent

    @property
    def prediction_error_percent(self) -> float:
        """Error of their one-step prediction, percent of their deviation from the mean."""
        return self.validation.prediction_error_percent

    @cached_property
    def checks(self) -> list[Check]:
        """The checks of the model: passed, failed or not judged, with a statement that says why."""
        return self.results.checks

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Decisions of the automatic recipe, with their alternatives and reasons."""
        return self.results.decisions.decisions if self.results.decisions else ()

    @property
    def verdict(self) -> str:
        """What the model is good for and what not, in a sentence."""
        return verdict(self.results).sentence

    @property
    def modes(self) -> pd.DataFrame:
        """Modes by frequency, with standard errors and whether the data give no reason for doubt.

        Columns ``frequency_hz``, ``frequency_se_hz``, ``damping_percent``, ``damping_se_percent``
        and ``trusted``.
        """
        trusted = {each.mode.pole for each in self.results.trusted_modes}
        rows = [
            (
                *(mode.frequency_hz, mode.frequency_se_hz),
                *(100.0 * mode.damping_ratio, 100.0 * mode.damping_se, mode.pole in trusted),
            )
            for mode in self.results.model.modes
        ]
        columns = ["frequency_hz", "frequency_se_hz", "damping_percent", "damping_se_percent"]
        index = pd.RangeIndex(1, len(rows) + 1, name="mode")
        return pd.DataFrame(rows, columns=[*columns, "trusted"], index=index)

    def __repr__(self) -> str:
        return results_text(self.results)

    def _repr_html_(self) -> str:
        return html_summary(self.results)

    def plot_measured_and_simulated(self, axes: Axes | None = None) -> Axes:
        """First validation samples, measured and simulated from the input alone."""
        return self._on_one(
            SUMMARY,
            axes,
            lambda own: draw_measured_and_simulated(
                self.results.validation_tables.simulation,
                self.results.model.modes,
                self.results.model.sampling_rate,
                panels.output_label(self.results),
                axes=own,
            ),
        )

    def plot_gain(self, axes: Axes | None = None) -> Axes:
        """Gain with its 95 % band over the estimate from the data; trusted modes are marked."""
        trusted = [each.mode.frequency_hz for each in self.results.trusted_modes]
        return self._on_one(
            SUMMARY,
            axes,
            lambda own: draw_gain_and_data(
                *(self.results.frequency_response, self.results.spectrum, trusted),
                panels.gain_unit(self.results),
                axes=own,
            ),
        )

    def plot_frequency_response(self, axes: Sequence[Axes] | None = None) -> list[Axes]:
        """Gain, phase and coherence over the data, on three axes."""
        return self._on(
            FREQUENCY_RESPONSE,
            axes,
            lambda own: draw_frequency_response(
                *(self.results.frequency_response, self.results.spectrum),
                *(panels.gain_unit(self.results), self.results.truth),
                axes=own,
            ),
        )

    def plot_nyquist(self, axes: Axes | None = None) -> Axes:
        """The frequency response in the complex plane."""
        return self._on_one(
            NYQUIST,
            axes,
            lambda own: draw_nyquist(
                *(self.results.frequency_response, self.results.spectrum),
                panels.gain_unit(self.results),
                axes=own,
            ),
        )

    def plot_step_response(self, axes: Axes | None = None) -> Axes:
        """Response to a unit step with its 95 % band; of a model with input."""
        if not self.model.has_input:
            raise InputError(
                "plot_step_response", "the model has no input", "plot its impulse response"
            )
        return self._response(*OF_PLANT[0], axes)

    def plot_impulse_response(self, axes: Axes | None = None) -> Axes:
        """Response to one sample of 1 with its 95 % band; without an input, of the noise filter."""
        return self._response(*(OF_PLANT[1] if self.model.has_input else OF_NOISE[0]), axes)

    def _response(self, column: str, title: str, axes: Axes | None) -> Axes:
        table = settling_part(self.results.time_response)
        unit = panels.gain_unit(self.results)

        def draw(own: Axes) -> None:
            draw_response(own, table, column, title, unit)
            own.set_xlabel("Time (s)")

        return self._on_one(RESPONSE, axes, draw)

    def plot_poles_zeros(self, axes: Sequence[Axes] | None = None) -> list[Axes]:
        """Poles and zeros with 95 % ellipses, and the modes with 95 % intervals, on two axes."""
        return self._on(
            POLES_ZEROS,
            axes,
            lambda own: draw_poles_zeros(self.model, self.results.truth, axes=own),
        )

    def plot_stabilization(self, axes: Axes | None = None) -> Axes:
        """Natural frequencies of the models of every order, over the spectrum of the output."""
        order = plant_order(self.model.orders.structure)
        return self._on_one(
            STABILIZATION,
            axes,
            lambda own: draw_stabilization(
                *(stabilization_table(self.results), self.model.sampling_rate),
                *(self.results.spectrum, getattr(self.results.models_of_orders.orders, order)),
                *(self.results.truth, order),
                axes=own,
            ),
        )

    def plot_residual_correlation(self, axes: Sequence[Axes] | None = None) -> list[Axes]:
        """Correlations of the residuals with themselves and with the input, on two axes."""
        tables = self.results.validation_tables
        return self._on(
            RESIDUALS,
            axes,
            lambda own: draw_residuals(
                tables.residual_autocorrelation, tables.cross_correlation, axes=own
            ),
        )

    def plot_residual_spectrum(self, axes: Axes | None = None) -> Axes:
        """Spectrum of the one-step errors on the validation samples; flat if they are white."""
        return self._on_one(
            RESIDUAL_SPECTRUM,
            axes,
            lambda own: draw_residual_spectrum(
                residual_spectrum_table(self.results), panels.output_unit(self.results), axes=own
            ),
        )

    def plot_spectrum(self, axes: Axes | None = None) -> Axes:
        """Multitaper spectrum of the output with its 95 % band and its peaks."""
        return self._on_one(
            SPECTRUM,
            axes,
            lambda own: draw_spectrum(
                *(self.results.spectrum, self.results.spectrum_summary.peaks),
                *(panels.output_unit(self.results), self.results.truth),
                axes=own,
            ),
        )

    def plot_horizons(self, axes: Axes | None = None) -> Axes:
        """Error of the prediction of the validation samples over its horizon."""
        return self._on_one(
            HORIZONS,
            axes,
            lambda own: draw_horizons(
                self.results.validation_tables.horizons, self.simulation_error_percent, axes=own
            ),
        )

    def compare(
        self, *others: IdentificationResults, labels: Sequence[str] = ()
    ) -> ModelComparison:
        """Lay this model beside others: their errors, their modes matched, and overlays.

        Parameters
        ----------
        *others : IdentificationResults
            One to five.
        labels : sequence of str, optional
            By default the names, and the orders where names agree.

        Raises
        ------
        InputError
            For too many, or labels that do not tell the models apart.
        """
        results = [self.results, *(each.results for each in others)]
        return ModelComparison(Comparison.of(results, labels))

    def report(self, file: str | Path) -> Path:
        """Write the report: one HTML page that loads no other file, as the workflow makes it.

        Raises
        ------
        InputError
            When matplotlib or jinja2 is missing, or the file cannot be written.
        """
        check_packages(FOR_REPORT, "report", "the figures and the page")
        from evopem.figures.registry import svg_texts
        from evopem.pipeline.report import report_page

        page = report_page(self.files, self.results, svg_texts(self.results))
        write_text(file, page)
        return Path(file)

    def save(self, folder: str | Path) -> Path:
        """Keep the files of the results in a folder, with the signals they were made from.

        :func:`evopem.read_results` opens it again, and its ``config.yaml`` repeats the
        identification there. Earlier results in the folder are replaced.

        Raises
        ------
        InputError
            When the folder holds something else.
        """
        target = Path(folder)
        empty = not target.exists() or (target.is_dir() and not any(target.iterdir()))
        if not empty and not (target / Path(self.files.config).name).is_file():
            raise InputError(str(folder), "holds other files than results", "choose a new folder")
        shutil.copytree(self.files.folder, target, dirs_exist_ok=True)
        if self._folder is not None and isinstance(self.results.settings.source, RecordedSource):
            for name in self.results.settings.source.all_files:
                shutil.copy(Path(self._folder.name) / name, target / name)
        return target

    def _on_one(self, grid: Grid, axes: Axes | None, draw: Callable[[Any], object]) -> Axes:
        check_packages(FOR_FIGURES, "plot", "the figures")
        (own,) = pyplot_panels(grid, axes)
        draw(own)
        return own

    def _on(
        self, grid: Grid, axes: Sequence[Axes] | None, draw: Callable[[Any], object]
    ) -> list[Axes]:
        check_packages(FOR_FIGURES, "plot", "the figures")
        own = pyplot_panels(grid, axes)
        draw(own)
        return own
