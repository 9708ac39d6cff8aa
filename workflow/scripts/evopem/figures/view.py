"""What figures and pages show of results: l outputs and m inputs in one form, l = m = 1 as well.

Tables name the channels in their columns output and input.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evopem.config.structures import structure_name
from evopem.errors import InputError
from evopem.estimation.model_record import FORMS
from evopem.figures.style import ratio_unit, with_unit
from evopem.models.mode_matching import PoleOfOrder
from evopem.results.dataset import DatasetResults
from evopem.signals.prepared_data import Transforms
from evopem.signals.spectra import multitaper_spectrum
from evopem.validation.checks.inputs import input_rests
from evopem.validation.checks.residuals import white

if TYPE_CHECKING:
    from evopem.signals.spectrum_summary import SpectralPeak
    from evopem.validation.checks import Check
    from evopem.validation.validation import OutputValidation

# Length of the transforms of the residuals: coarse, since white noise has no lines.
RESIDUAL_NFFT = 1024
ROOTS = (
    ("a", "pole"),
    ("f", "pole of the plant"),
    ("b", "zero"),
    ("c", "root of C"),
    ("d", "pole of the noise filter"),
)
_RESPONSE = ("gain", "gain_lower", "gain_upper", "phase_deg")
UNKNOWN = np.full((2, 2), np.nan)


@dataclass(frozen=True)
class Channel:
    """An input or output."""

    name: str  # as recorded
    unit: str
    prepared: str  # after the transforms
    prepared_unit: str

    @property
    def label(self) -> str:
        """Name with unit after the transforms."""
        return with_unit(self.prepared, self.prepared_unit)


Pair = tuple[Channel, Channel | None]


class View:
    """Results in one form, with their tables, which are made when they are asked for."""

    def __init__(self, results: DatasetResults) -> None:
        recording, record, validation = results.recording, results.model, results.validation
        transforms, count = record.transforms, record.model.inputs
        self.results = results
        # A power transform leaves the output without a unit.
        self.outputs = tuple(
            Channel(
                *(name, unit, _output_name(transforms, name)),
                unit if transforms.box_cox is None else "",
            )
            for name, unit in zip(recording.output_names, recording.output_units, strict=True)
        )
        given = zip(recording.input_names[:count], recording.input_units[:count], strict=True)
        self.inputs = tuple(
            Channel(name, unit, _differenced(transforms.difference_input, name), unit)
            for name, unit in given
        )
        tables = results.validation_tables
        self.simulation, self.horizons = tables.simulation, tables.horizons
        self.name, self.sampling_rate = results.name, float(record.sampling_rate)
        self.model_text, self.structure, self.truth = record.text, record.structure, results.truth
        self.has_input = bool(self.inputs)
        self.is_single = len(self.outputs) == 1 and len(self.inputs) <= 1
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
        # Of a search by phases
        self.candidates = results.candidates if results.phases else None
        # Errors in recorded units, where these are others
        shows_recorded = self.changes_output and self.is_single
        self.recorded = validation.outputs[0].recorded if shows_recorded else None

    @property
    def checks(self) -> list[Check]:
        """The checks of the model."""
        return self.results.checks

    @property
    def pairs(self) -> list[Pair]:
        """Every output with every input; each output alone where there is no input."""
        sources = self.inputs or (None,)
        return [(output, source) for output in self.outputs for source in sources]

    def pair_title(self, output: Channel, source: Channel | None = None) -> str:
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
    def stabilization(self) -> pd.DataFrame:
        """Poles over the orders, each with its status."""
        columns = ["order", "frequency_hz", "damping_ratio", "status"]
        table = pd.DataFrame([vars(pole) for pole in self.poles_of_orders], columns=columns)
        table.insert(2, "damping_percent", 100 * table.pop("damping_ratio"))
        return table

    @cached_property
    def convergence(self) -> Sequence[tuple[int, float]]:
        """Evaluations and lowest objective of the search for the model."""
        return self.results.model.search.diagnostics.convergence

    @property
    def is_chosen_by_scores(self) -> bool:
        """Whether the automatic recipe chose the model among others."""
        return self.results.decisions is not None and len(self.scores) > 1

    @property
    def standard_errors(self) -> np.ndarray:
        """Of the coefficients of polynomials, or of the entries of a state-space model."""
        record = self.results.model
        if record.parameter_standard_errors is not None:
            return np.asarray(record.parameter_standard_errors)
        known = record.orders is None and record.model.covariance is not None
        return np.full(record.model.parameters.size, 0.0 if known else np.nan)

    @property
    def worst_first(self) -> list[tuple[Channel, OutputValidation]]:
        """The outputs by decreasing error of the simulation, without an input of the prediction."""

        def severity(pair: tuple[Channel, OutputValidation]) -> float:
            _, own = pair
            error = own.simulation_error_percent if self.has_input else own.prediction_error_percent
            return -error if np.isfinite(error) else -np.inf

        return sorted(zip(self.outputs, self.results.validation.outputs, strict=True), key=severity)

    @cached_property
    def scores(self) -> pd.DataFrame:
        """Errors on held-out samples by structure and order, the choice selected."""
        choice, table = self.results.choice, self.results.candidates
        assert choice is not None
        error = f"{choice.kind}_error_percent"
        table = table[(table["step"] != "remedy") & table[error].notna()]
        table = table.rename(columns={error: "error_percent"}).reset_index(drop=True)
        names = {name: FORMS.get(name) or structure_name(name) for name in set(table["structure"])}
        columns = ["structure", "order", "model", "error_percent", "bic", "selected"]
        return table.replace({"structure": names})[columns]

    @cached_property
    def frequency_response(self) -> pd.DataFrame:
        """Of the model, its noise filter and the data; without an input of the noise filter."""
        table = self.results.frequency_response
        noise = _response(table, "noise filter", "noise_")
        if not self.inputs:
            return noise.drop(columns=["input", "coherence"])
        measured = _response(self.results.spectrum, "measured", "frequency_response_")
        model = _response(table, "model", "").assign(coherence=np.nan)
        return pd.concat([model, noise.assign(coherence=np.nan), measured], ignore_index=True)

    @cached_property
    def spectrum(self) -> pd.DataFrame:
        """Multitaper spectra of the prepared outputs."""
        table = self.results.spectrum
        own = table[table["input"] == self.inputs[0].name] if self.inputs else table
        return own[["output", "frequency_hz", "density", "lower", "upper"]].reset_index(drop=True)

    @property
    def peaks(self) -> dict[str, Sequence[SpectralPeak]]:
        """Of each spectrum, by the names of the outputs."""
        summaries = self.results.spectrum_summaries
        names = [output.name for output in self.outputs]
        return {name: each.peaks for name, each in zip(names, summaries, strict=True)}

    @cached_property
    def residual_spectrum(self) -> pd.DataFrame:
        """Spectra of the one-step errors on the validation samples, by output."""
        tables = []
        for output in self.outputs:
            name, table = output.name, self.simulation
            errors = (table[f"output_{name}"] - table[f"predicted_{name}"]).dropna()
            found = spectrum_of(errors.to_numpy(dtype=float), self.sampling_rate, RESIDUAL_NFFT)
            tables.append(found.assign(output=name)[["output", *found.columns]])
        return pd.concat(tables, ignore_index=True)

    @cached_property
    def roots(self) -> pd.DataFrame:
        """Roots of polynomials of one input with covariances, else poles of model and predictor."""
        record = self.results.model
        if record.orders is not None and record.model.inputs <= 1:
            found = [
                (kind, *root)
                for letter, kind in ROOTS
                for root in record.polynomials.uncertain_roots(letter)
            ]
        else:
            model = record.state_space
            kinds = {"pole": model.poles()}
            if record.has_noise_model:
                kinds["root of C"] = model.noise_zeros()
            found = [(kind, root, UNKNOWN) for kind, values in kinds.items() for root in values]
        for mode in self.results.truth.modes if self.results.truth else ():
            found += [("true pole", z, UNKNOWN) for z in (mode.pole, mode.pole.conjugate())]
        rows = [
            (kind, root.real, root.imag, abs(root), c[0, 0], c[1, 1], c[0, 1])
            for kind, root, c in found
        ]
        columns = ["kind", "real", "imag", "radius", "variance_real", "variance_imag", "covariance"]
        return pd.DataFrame(rows, columns=columns)

    @property
    def poles_of_orders(self) -> Sequence[PoleOfOrder]:
        """Poles over the orders, each compared with the next lower order."""
        return self.results.validation.modes.poles

    @cached_property
    def signals(self) -> pd.DataFrame:
        """All channels as recorded and as used."""
        prepared, inputs, outputs = self.results.prepared, self.inputs, self.outputs
        begin = prepared.estimation.samples / prepared.estimation.sampling_rate
        names = [*(f"input_{each.name}" for each in inputs), *(f"output_{o.name}" for o in outputs)]
        tables = []
        for stage, part, first in (
            ("recorded", self.results.recording, 0.0),
            ("estimation", prepared.estimation, 0.0),
            ("validation", prepared.validation, begin),
        ):
            columns = np.column_stack([part.inputs[:, : len(inputs)], part.outputs])
            table = pd.DataFrame(columns, columns=names)
            table.insert(0, "time_s", first + np.arange(part.samples) / part.sampling_rate)
            table.insert(0, "stage", stage)
            tables.append(table)
        return pd.concat(tables, ignore_index=True)


def view_of(results: DatasetResults | View) -> View:
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


def _response(table: pd.DataFrame, source: str, prefix: str) -> pd.DataFrame:
    """The columns of one response of a table, whose names begin with a prefix."""
    own = [name for name in ("output", "input", "frequency_hz", "coherence") if name in table]
    values = [f"{prefix}{name}" for name in _RESPONSE if f"{prefix}{name}" in table]
    found = table[[*own, *values]].rename(columns=lambda name: name.removeprefix(prefix))
    columns = ["source", "output", "input", "frequency_hz", *_RESPONSE, "coherence"]
    return found.assign(source=source).reindex(columns=columns)


def spectrum_of(signal: np.ndarray, rate: float, nfft: int) -> pd.DataFrame:
    """Multitaper spectrum with its band and the level of white noise; empty for a short signal."""
    columns = ["frequency_hz", "density", "lower", "upper", "white_level"]
    try:
        found = multitaper_spectrum(signal, rate, nfft=nfft)
    except InputError:
        return pd.DataFrame(columns=columns, dtype=float)
    values = (found.frequencies, found.density, found.lower, found.upper)
    table = pd.DataFrame(dict(zip(columns, values, strict=False)))
    return table.assign(white_level=2.0 * float(np.var(signal)) / rate)
