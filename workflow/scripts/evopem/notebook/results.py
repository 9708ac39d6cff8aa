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
from evopem.automatic.varying import Varying, table_of
from evopem.errors import FOR_FIGURES, FOR_REPORT, InputError, check_packages
from evopem.figures import CHARTS
from evopem.figures.chart import Chart
from evopem.figures.comparison import compared_modes, compared_responses, compared_simulations
from evopem.figures.draw import draw, panels_of
from evopem.figures.moving import moving_modes
from evopem.figures.style import PARAMETERS
from evopem.files import checksums
from evopem.files.atomic import files_below
from evopem.files.json_form import load, save
from evopem.models.polynomial import PolynomialModel
from evopem.models.state_space import StateSpaceModel
from evopem.report.comparison import build_comparison, comparison_text
from evopem.report.results_text import moving_sentence, results_html, results_text
from evopem.report.verdict import Use, verdict
from evopem.results.comparison import Comparison
from evopem.results.dataset import DatasetResults
from evopem.results.fleet import MODE_COLUMNS, DatasetSummary, mode_values
from evopem.results.layout import DatasetFiles
from evopem.validation.checks import Check
from evopem.validation.validation import Validation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# A notebook's page may be dark, and the figures are drawn for paper.
_PAPER = {"figure.facecolor": "white", "axes.facecolor": "white", "savefig.facecolor": "white"}


def _drawn(chart: Chart, axes: Any) -> list[Axes]:
    """A chart on the given axes, or on a new figure that pyplot keeps and a notebook shows."""
    check_packages(FOR_FIGURES, "plot", "the figures")
    from matplotlib import pyplot, rc_context

    # The backend starts with the first figure and sets parameters of its own, such as that figures
    # are shown: a context around its start would take these back.
    if axes is None and getattr(pyplot, "_backend_mod", None) is None:
        pyplot.close(pyplot.figure())
    with rc_context(PARAMETERS | _PAPER):
        panels = panels_of(chart, axes, pyplot.figure)
    draw(chart, panels)
    return panels


def _plot(chart_of: Callable[[Any], Chart], kind: str = "") -> Callable[..., Any]:
    """The method that plots a figure of results, or its panels of one kind of column."""

    def plot(self: Any, axes: Axes | Sequence[Axes] | None = None) -> Axes | list[Axes]:
        chart = chart_of(getattr(self, "results", self))
        if kind and not (chart := chart.only(kind)).panels:
            raise InputError(plot.__name__, "the model has no input", "take plot_impulse_response")
        panels = _drawn(chart, axes)
        return panels if len(panels) > 1 else panels[0]

    plot.__doc__ = chart_of.__doc__
    return plot


class _Reported:
    """What is written as a page."""

    _page: Callable[[], str]

    def report(self, file: str | Path) -> Path:
        """Write one HTML page that loads no other file, as the workflow makes it.

        Raises
        ------
        InputError
            When matplotlib or jinja2 is missing, or the file cannot be written.
        """
        check_packages(FOR_REPORT, "report", "the figures and the page")
        checksums.check_page(file)  # before the work
        checksums.write_page(file, self._page())
        return Path(file)


@dataclass(frozen=True, eq=False, repr=False)
class Results(_Reported):
    """What an identification found; in a notebook it shows verdict, modes and errors.

    Every figure of the report has a ``plot_…`` of its name, which takes the axes to draw on, by
    default new ones, and returns them: one, or a list of several.

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

    @property
    def name(self) -> str:
        """Name of the data set."""
        return self.results.name

    @property
    def model(self) -> PolynomialModel | StateSpaceModel:
        """The model: it simulates, predicts, and gives its modes and frequency response."""
        return self.results.model.model

    @property
    def varying(self) -> VaryingResults | None:
        """What moves: a model with moving coefficients, or why there is none; None if not tried."""
        known = self.results.varying
        return VaryingResults(known.reason, known.moves, known.model) if known else None

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
    def uses(self) -> tuple[Use, ...]:
        """The same one by one: each with its ``key``, its ``answer`` and the reason for it."""
        return tuple(verdict(self.results).uses)

    @property
    def modes(self) -> pd.DataFrame:
        """Modes by frequency, with standard errors and whether the data give no reason for doubt.

        Columns ``frequency_hz``, ``frequency_se_hz``, ``damping_percent``, ``damping_se_percent``
        and ``trusted``.
        """
        rows = [
            (*mode_values(mode), trusted)
            for mode, trusted in zip(self.summary.modes, self.summary.trusted, strict=True)
        ]
        index = pd.RangeIndex(1, len(rows) + 1, name="mode")
        types = dict.fromkeys(MODE_COLUMNS, float) | {"trusted": bool}
        return pd.DataFrame(rows, columns=list(types), index=index).astype(types)

    @property
    def shapes(self) -> pd.DataFrame:
        """Shapes of the modes over several outputs: a row for each mode, a column for each output.

        Raises
        ------
        InputError
            When there is one output.
        """
        names = self.results.model.output_names
        if len(names) == 1:
            raise InputError("shapes", "a mode of one output has no shape", "take modes")
        shapes = [mode.shape for mode in self.summary.modes]
        index = pd.RangeIndex(1, len(shapes) + 1, name="mode")
        return pd.DataFrame(shapes, columns=list(names), index=index)

    @cached_property
    def summary(self) -> DatasetSummary:
        """Orders, errors, modes and checks in a few numbers."""
        return load(DatasetSummary, self.files.summary)

    def __repr__(self) -> str:
        return results_text(self.name, self.verdict, self.summary)

    def _repr_html_(self) -> str:
        return results_html(self.name, self.verdict, self.summary)

    plot_step_response = _plot(CHARTS["step_and_impulse"], "step")
    """Response to a unit step with its 95 % band; of a model with input."""
    plot_impulse_response = _plot(CHARTS["step_and_impulse"], "impulse")
    """Response to one sample of 1 with its 95 % band; without an input, of the noise filter."""

    def compare(
        self, *others: Results, labels: Sequence[str] = (), setups: bool = False
    ) -> ModelComparison:
        """Lay this model beside others: their errors, their modes matched, and overlays.

        Parameters
        ----------
        *others : Results
            One to five.
        labels : sequence of str, optional
            By default the names, and the orders where names agree.
        setups : bool
            They are set-ups of one structure with common channels: ``merged`` has their modes.

        Raises
        ------
        InputError
            For too many, or labels that do not tell the models apart.
        """
        for compared in others:
            if not isinstance(getattr(compared, "results", None), DatasetResults):
                problem = f"{compared!r:.40} is no result"
                raise InputError("compare", problem, "give what identify or estimate returns")
        return ModelComparison.of([model.results for model in (self, *others)], labels, setups)

    def _page(self) -> str:
        from evopem.figures import svg_texts
        from evopem.pipeline.report import report_page

        return report_page(self.files, self.results, svg_texts(self.results))

    def save(self, folder: str | Path) -> Path:
        """Keep the files of the results in a folder, with the signals they were made from.

        :func:`evopem.read_results` opens it again, and its ``config.yaml`` repeats the
        identification there. Earlier results in the folder are replaced, and nothing else.

        Raises
        ------
        InputError
            When the folder holds another file of the name of a result, or a changed result.
        """
        target, made = Path(folder), Path(self.files.folder)
        empty = not target.exists() or (target.is_dir() and not any(target.iterdir()))
        if not empty and not checksums.checksummed(target):
            raise InputError(str(folder), "holds other files than results", "choose a new folder")
        if target.resolve() == made.resolve():
            return target
        copies = {target / file.relative_to(made): file for file in files_below(made, "")}
        recorded = self.results.settings.source.all_files
        if self._folder is not None and recorded:
            root = Path(self._folder.name)
            copies |= {target / name: root / name for name in recorded}
        checksums.check_replaceable(copies, target)
        checksums.delete_results(target)
        for copy, file in copies.items():
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, copy)
        checksums.write_checksums(copies, target, checksums.COMMAND)
        return target


@dataclass(frozen=True, eq=False, repr=False)
class VaryingResults(Varying):
    """What moves; in a notebook it shows the sentence of the report.

    Its ``model`` simulates, predicts and freezes; ``moves`` has errors of samples held out, beside
    those of constant models.
    """

    def __repr__(self) -> str:
        return moving_sentence(self.moves) or f"No model with moving coefficients: {self.reason}."

    @property
    def modes(self) -> pd.DataFrame:
        """Modes over the schedule with 95 % intervals, as ``varying_modes.csv`` has them."""
        return pd.DataFrame(table_of(self)).astype({"mode": int})

    plot_modes = _plot(moving_modes)
    """Natural frequencies and damping ratios with 95 % bands."""

    def save(self, file: str | Path) -> None:
        """Write it as JSON, the form of ``varying.json``."""
        save(Varying(self.reason, self.moves, self.model), file)


@dataclass(frozen=True, eq=False, repr=False)
class ModelComparison(_Reported, Comparison):
    """Two to six models side by side; in a notebook it shows errors and modes.

    Its ``table`` has a row for each model, its ``modes`` one for each mode of each model.
    """

    def __repr__(self) -> str:
        return comparison_text(self)

    def _repr_html_(self) -> str:
        tables = [self.table, self.modes.set_index(["mode", "data set"])]
        return "".join(table.to_html(float_format="{:.4g}".format) for table in tables)

    plot_frequency_responses = _plot(compared_responses)
    """Gain and phase of every model and pair."""
    plot_simulations = _plot(compared_simulations)
    """First validation samples, measured and simulated by every model."""
    plot_modes = _plot(compared_modes)
    """Damping over frequency with 95 % intervals; open where a mode is not to be trusted."""

    def _page(self) -> str:
        return build_comparison(self)


for _name, _chart_of in CHARTS.items():
    setattr(Results, f"plot_{_name}", _plot(_chart_of))
for _class in (Results, VaryingResults, ModelComparison):
    for _name, _method in vars(_class).items():
        if _name.startswith("plot_"):
            _method.__name__ = _name
