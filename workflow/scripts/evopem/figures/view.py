"""What figures and pages show of results: l outputs and m inputs in one form, l = m = 1 as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.config.structures import plant_order
from evopem.figures.style import ratio_unit, with_unit
from evopem.figures.tables import Channel, Tables
from evopem.results.dataset import DatasetResults
from evopem.signals.prepared_data import Transforms
from evopem.validation.checks.inputs import input_rests
from evopem.validation.checks.residuals import white

if TYPE_CHECKING:
    from evopem.validation.checks import Check
    from evopem.validation.validation import OutputValidation, RecordedErrors

Results = DatasetResults
Pair = tuple[Channel, Channel | None]


class View(Tables):
    """Results in one form."""

    def __init__(self, results: DatasetResults) -> None:
        recording, record, validation = results.recording, results.model, results.validation
        transforms, count = record.transforms, record.model.inputs
        # A power transform leaves the output without a unit.
        outputs = [
            Channel(
                *(name, unit, _output_name(transforms, name)),
                unit if transforms.box_cox is None else "",
            )
            for name, unit in zip(recording.output_names, recording.output_units, strict=True)
        ]
        given = zip(recording.input_names[:count], recording.input_units[:count], strict=True)
        inputs = [
            Channel(name, unit, _differenced(transforms.difference_input, name), unit)
            for name, unit in given
        ]
        super().__init__(results, outputs, inputs)
        self.name, self.sampling_rate = results.name, float(record.sampling_rate)
        self.model_text, self.structure, self.truth = record.text, record.structure, results.truth
        self.has_input, self.is_single = bool(inputs), len(outputs) == 1 and len(inputs) <= 1
        # Whether the model claims anything of the noise.
        self.has_noise_model = record.has_noise_model
        # Modes with what the data say of each, and those of the noise filter alone.
        judged = validation.modes.modes
        self.modes = [each.mode for each in judged]
        self.trusted = [each.trusted for each in judged]
        self.evidence = {each.mode.pole: each for each in judged}
        shared = {mode.pole for mode in record.modes}
        self.noise_modes = [mode for mode in record.noise_modes if mode.pole not in shared]
        self.white = white(validation)  # None where it is not known
        self.input_rests = bool(count) and input_rests(validation)
        self.changes_output = transforms.changes_output
        self.is_transformed = self.changes_output or transforms.difference_input > 0
        self.order_name = "of the plant" if record.orders else "n"
        self.candidates: pd.DataFrame | None = None
        self.recorded: RecordedErrors | None = None  # errors in recorded units, where others
        self.has_poles_of_orders = True
        if results.settings.is_single_channel:
            self.order_name = plant_order(self.structure)
            self.candidates = results.candidates
            by_recipe = self.structure != "fir" if results.decisions else "joint" in results.phases
            self.has_poles_of_orders = by_recipe
            if self.changes_output:
                self.recorded = validation.outputs[0].recorded

    @property
    def checks(self) -> list[Check]:
        """The checks of the model."""
        return self.results.checks

    @property
    def pairs(self) -> list[Pair]:
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
    def selected_order(self) -> int:
        """The order at which all orders were tied, or of the chosen state-space model."""
        if not self.results.settings.is_single_channel:
            return self.results.validation.modes.order
        return int(getattr(self.results.models_of_orders.orders.single, self.order_name))

    @cached_property
    def stabilization(self) -> pd.DataFrame:
        """Poles over the orders, each with its status."""
        columns = ["order", "frequency_hz", "damping_ratio", "status"]
        table = pd.DataFrame([asdict(pole) for pole in self.poles_of_orders], columns=columns)
        table.insert(2, "damping_percent", 100 * table.pop("damping_ratio"))
        return table

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
    def worst_first(self) -> list[tuple[Channel, OutputValidation]]:
        """The outputs by decreasing error of the simulation, without an input of the prediction."""

        def severity(pair: tuple[Channel, OutputValidation]) -> float:
            _, own = pair
            error = own.simulation_error_percent if self.has_input else own.prediction_error_percent
            return -error if np.isfinite(error) else -np.inf

        return sorted(zip(self.outputs, self.results.validation.outputs, strict=True), key=severity)


def view_of(results: Results | View) -> View:
    """The view of results, of whatever channels."""
    return results if isinstance(results, View) else View(results)


def _differenced(count: int, name: str) -> str:
    """What the difference of a channel is called: "second difference of torque"."""
    if not count:
        return name
    ordinal = {1: "first", 2: "second", 3: "third"}.get(count, f"{count}th")
    return f"{ordinal} difference of {name}"


def _output_name(transforms: Transforms, name: str) -> str:
    """Name of an output after its transforms."""
    shown = name if transforms.box_cox is None else f"Box-Cox transformed {name}"
    return _differenced(transforms.difference, shown)
