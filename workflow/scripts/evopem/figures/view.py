"""What figures and pages show of results: l outputs and m inputs in one form, as plain tables.

Channels stand in the columns ``output`` and ``input`` of a table; one of each is l = m = 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.config.structures import plant_order
from evopem.figures import view_tables
from evopem.figures.style import ratio_unit, with_unit
from evopem.figures.view_tables import Channel, by_output, spectrum_of
from evopem.models.mode_matching import StabilizationPole
from evopem.results.dataset import DatasetResults
from evopem.signals.prepared_data import Transforms
from evopem.validation.checks.inputs import input_rests
from evopem.validation.checks.residuals import white

if TYPE_CHECKING:
    from evopem.signals.spectral.summary import SpectralPeak
    from evopem.validation.checks import Check
    from evopem.validation.validation import RecordedErrors

Results = DatasetResults
# Length of the transforms of the residual spectrum: coarse, since white noise has no lines.
RESIDUAL_NFFT = 1024


@dataclass(frozen=True)
class OutputErrors:
    """Errors in percent, and tests, of one output on validation samples; NaN where not known."""

    name: str
    prediction: float  # one step ahead
    simulation: float  # that sees none of these outputs
    fitted_state: float  # of a simulation from the state that fits them
    whiteness_p: float
    outliers: float  # percent of the residuals


class View:
    """Results in one form; tables are made when they are asked for."""

    def __init__(self, results: DatasetResults) -> None:
        self.results = results
        recording, record, validation = results.recording, results.model, results.validation
        transforms, count = record.transforms, record.model.inputs
        self.outputs = tuple(
            Channel(
                *(name, unit, _output_name(transforms, name)),
                _output_unit(transforms, unit),
            )
            for name, unit in zip(recording.output_names, recording.output_units, strict=True)
        )
        inputs = list(zip(recording.input_names, recording.input_units, strict=True))[:count]
        self.inputs = tuple(
            Channel(name, unit, _input_name(transforms, name), unit) for name, unit in inputs
        )
        self.model_text, self.structure, self.truth = record.text, record.structure, results.truth
        # Modes with what the data say of each, and those of the noise filter alone.
        judged = validation.modes.modes
        self.modes = [each.mode for each in judged]
        self.trusted = [each.trusted for each in judged]
        self.evidence = {each.mode.pole: each for each in judged}
        shared = {mode.pole for mode in record.modes}
        self.noise_modes = [mode for mode in record.noise_modes if mode.pole not in shared]
        self.white = white(validation)  # None where it is not known
        self.input_rests = bool(count) and input_rests(validation)
        self.is_transformed = transforms.changes_output or transforms.difference_input > 0
        self.order_name = "of the plant" if record.orders else "n"
        self.candidates: pd.DataFrame | None = None
        self.recorded: RecordedErrors | None = None  # errors in recorded units, where others
        self.has_poles_of_orders = True
        if results.settings.is_single_channel:
            self.order_name = plant_order(self.structure)
            self.candidates = results.candidates
            by_recipe = self.structure != "fir" if results.decisions else "joint" in results.phases
            self.has_poles_of_orders = by_recipe
            if transforms.changes_output:
                self.recorded = validation.outputs[0].recorded

    @property
    def name(self) -> str:
        """Name of the data set."""
        return str(self.results.name)

    @property
    def checks(self) -> list[Check]:
        """The checks of the model."""
        found: list[Check] = self.results.checks
        return found

    @property
    def has_input(self) -> bool:
        """Whether the model has an input."""
        return bool(self.inputs)

    @property
    def is_single(self) -> bool:
        """Whether there is one output and at most one input."""
        return len(self.outputs) == 1 and len(self.inputs) <= 1

    @property
    def sampling_rate(self) -> float:
        """Of the prepared samples, Hz."""
        return float(self.results.model.sampling_rate)

    @property
    def pairs(self) -> list[tuple[Channel, Channel | None]]:
        """Every output with every input; each output alone where there is no input."""
        sources = self.inputs or (None,)
        return [(output, source) for output in self.outputs for source in sources]

    def pair_title(self, output: Channel, source: Channel | None) -> str:
        """What a panel of a pair is called; empty where there is one pair."""
        if len(self.pairs) == 1:
            return ""
        return output.name if source is None else f"{output.name} ← {source.name}"

    def where(self, output: Channel, source: Channel | None = None) -> tuple[tuple[str, str], ...]:
        """The rows of a pair in a table."""
        found = (("output", output.name),)
        return found if source is None else (*found, ("input", source.name))

    def gain_unit(self, output: Channel, source: Channel | None) -> str:
        """Unit of a gain of prepared signals."""
        return "" if source is None else ratio_unit(output.prepared_unit, source.prepared_unit)

    def density_label(self, output: Channel) -> str:
        """Label of a power spectral density of a prepared output."""
        unit = output.prepared_unit
        return with_unit("Power spectral density", f"({unit})²/Hz" if unit else "per Hz")

    @cached_property
    def residual_spectrum(self) -> pd.DataFrame:
        """Spectra of the one-step errors on the validation samples, by output."""
        tables = [
            spectrum_of(self.residuals_of(output), self.sampling_rate, RESIDUAL_NFFT)
            for output in self.outputs
        ]
        return by_output(self.outputs, tables)

    def residuals_of(self, output: Channel) -> np.ndarray:
        """One-step errors of an output on the validation samples."""
        table = self.simulation
        errors = table[f"output_{output.name}"] - table[f"predicted_{output.name}"]
        return np.asarray(errors.dropna(), dtype=float)

    @property
    def autocorrelation(self) -> pd.DataFrame:
        """Of the residuals, by output and lag."""
        return self.results.validation_tables.residual_autocorrelation

    @property
    def cross_correlation(self) -> pd.DataFrame:
        """Of residuals and inputs, by output, input and lag."""
        return self.results.validation_tables.cross_correlation

    @property
    def horizons(self) -> pd.DataFrame:
        """Errors of predictions by output and horizon."""
        return self.results.validation_tables.horizons

    @cached_property
    def errors(self) -> tuple[OutputErrors, ...]:
        """Of each output."""
        return tuple(
            OutputErrors(
                *(channel.prepared, found.prediction_error_percent),
                *(found.simulation_error_percent, found.fitted_state_error_percent),
                *(found.ljung_box.p_value, found.outlier_percent),
            )
            for channel, found in zip(self.outputs, self.results.validation.outputs, strict=True)
        )

    @cached_property
    def selected_order(self) -> int:
        """The order at which all orders were tied, or of the chosen state-space model."""
        if not self.results.settings.is_single_channel:
            return self.results.validation.modes.order
        return int(getattr(self.results.models_of_orders.orders.single, self.order_name))

    @property
    def simulation(self) -> pd.DataFrame:
        """As in ``simulation.csv``."""
        return self.results.validation_tables.simulation

    @cached_property
    def recorded_simulation(self) -> pd.DataFrame | None:
        """In recorded units; None where the transforms leave these."""
        if self.recorded is None:
            return None
        (output,) = self.outputs
        names = ["recorded_output", "recorded_simulated", "recorded_predicted"]
        table = self.simulation[["time_s", *(f"{name}_{output.name}" for name in names)]]
        return table.set_axis(["time_s", *names], axis="columns")

    @cached_property
    def frequency_response(self) -> pd.DataFrame:
        """Of the model and the estimate from the data; without an input of the noise filter."""
        return view_tables.frequency_response(self.results, self.outputs, self.inputs)

    @cached_property
    def time_response(self) -> pd.DataFrame:
        """Responses to a step and an impulse."""
        return view_tables.time_response(self.results, self.outputs, self.inputs)

    @cached_property
    def _spectra(self) -> tuple[pd.DataFrame, dict[str, Sequence[SpectralPeak]]]:
        return view_tables.spectra(self.results, self.outputs)

    @property
    def spectrum(self) -> pd.DataFrame:
        """Multitaper spectra of the prepared outputs."""
        return self._spectra[0]

    @property
    def peaks(self) -> dict[str, Sequence[SpectralPeak]]:
        """Of each spectrum, by the names of the outputs."""
        return self._spectra[1]

    @cached_property
    def roots(self) -> pd.DataFrame:
        """Roots of the polynomials or poles of the state-space model."""
        return view_tables.roots(self.results)

    @cached_property
    def poles_of_orders(self) -> Sequence[StabilizationPole]:
        """Poles over the orders, each compared with the next lower order."""
        return view_tables.poles_of_orders(self.results)

    @cached_property
    def signals(self) -> pd.DataFrame:
        """All channels as recorded and as used."""
        return view_tables.signals(self.results, self.outputs, self.inputs)

    @cached_property
    def scores(self) -> pd.DataFrame:
        """Errors on held-out samples by structure and order, the choice selected."""
        return view_tables.scores(self.results)

    @cached_property
    def convergence(self) -> Sequence[tuple[int, float]]:
        """Evaluations and lowest objective of the search for the model."""
        results = self.results
        found = results.selected if results.phases else results.model.search
        return found.diagnostics.convergence

    @property
    def is_chosen_by_scores(self) -> bool:
        """Whether the automatic recipe chose the model among others."""
        if self.results.decisions is None:
            return False
        structures = self.results.phases.get("structures")
        return len(structures.candidates if structures else self.scores) > 1

    @property
    def has_noise_model(self) -> bool:
        """Whether the model claims anything of the noise."""
        return bool(self.results.model.has_noise_model)

    @property
    def standard_errors(self) -> np.ndarray:
        """Of the coefficients of polynomials, or of the entries of a state-space model."""
        record = self.results.model
        if record.parameter_standard_errors is not None:
            return np.asarray(record.parameter_standard_errors)
        known = record.orders is None and record.model.covariance is not None
        return np.full(record.model.parameters.size, 0.0 if known else np.nan)

    @property
    def input_deviations(self) -> np.ndarray:
        """Standard deviations of the inputs on the estimation samples, (m,)."""
        return np.asarray(self.results.prepared.estimation.inputs.std(axis=0))

    @property
    def worst_first(self) -> list[tuple[Channel, OutputErrors]]:
        """The outputs by decreasing error of the simulation, without an input of the prediction."""

        def severity(pair: tuple[Channel, OutputErrors]) -> float:
            error = pair[1].simulation if self.has_input else pair[1].prediction
            return -error if np.isfinite(error) else -np.inf

        return sorted(zip(self.outputs, self.errors, strict=True), key=severity)

    @property
    def trusted_frequencies(self) -> list[float]:
        """Natural frequencies of the modes that nothing speaks against, in Hz."""
        return [m.frequency_hz for m, kept in zip(self.modes, self.trusted, strict=True) if kept]


def view_of(results: Results | View) -> View:
    """The view of results, of whatever channels."""
    return results if isinstance(results, View) else View(results)


def stabilization_table(view: View) -> pd.DataFrame:
    """Poles over the orders, each with its status."""
    columns = ["order", "frequency_hz", "damping_ratio", "status"]
    table = pd.DataFrame([asdict(pole) for pole in view.poles_of_orders], columns=columns)
    table.insert(2, "damping_percent", 100 * table.pop("damping_ratio"))
    return table


_ORDINALS = {1: "first", 2: "second", 3: "third"}


def _differences(count: int) -> str:
    """Name of a difference: "second difference"."""
    return f"{_ORDINALS.get(count, f'{count}th')} difference"


def _output_name(transforms: Transforms, name: str) -> str:
    """Name of the output after its transforms."""
    shown = name if transforms.box_cox is None else f"Box-Cox transformed {name}"
    return f"{_differences(transforms.difference)} of {shown}" if transforms.difference else shown


def _output_unit(transforms: Transforms, unit: str) -> str:
    """Unit of the output after its transforms; empty after a power transform."""
    return unit if transforms.box_cox is None else ""


def _input_name(transforms: Transforms, name: str) -> str:
    """Name of the input after its transforms."""
    count = transforms.difference_input
    return f"{_differences(count)} of {name}" if count else name
