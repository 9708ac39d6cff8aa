"""What figures and pages show of results: l outputs and m inputs in one form, as plain tables.

Channels stand in the columns ``output`` and ``input`` of a table; one of each is l = m = 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from evopem.config.structures import plant_order, structure_name
from evopem.errors import InputError
from evopem.figures.signal_labels import (
    prepared_input_name,
    prepared_output_name,
    prepared_output_unit,
)
from evopem.figures.style import ratio_unit, with_unit
from evopem.models.modes import Mode
from evopem.models.stabilization import (
    StabilizationPole,
    stabilization,
    stabilization_of_modes,
)
from evopem.models.uncertain_roots import Polynomial, uncertain_roots
from evopem.results.dataset import DatasetResults
from evopem.signals.spectral.multitaper import multitaper_spectrum
from evopem.signals.spectral.peaks import spectral_peaks
from evopem.validation.checks.inputs import input_rests
from evopem.validation.checks.residuals import white

if TYPE_CHECKING:
    from evopem.signals.spectral.summary import SpectralPeak
    from evopem.synthesis.truth import Truth
    from evopem.validation.checks import Check
    from evopem.validation.mode_evidence import ModeEvidence
    from evopem.validation.recorded_units import RecordedErrors

Results = DatasetResults
# Length of the transforms of the residual spectrum: coarse, since white noise has no lines.
RESIDUAL_NFFT = 1024
SPECTRUM_NFFT = 2048
# Samples of a time response of a state-space model at most.
RESPONSE_SAMPLES = 500
ROOTS: tuple[tuple[Polynomial, str], ...] = (
    ("A", "pole"),
    ("F", "pole of the plant"),
    ("B", "zero"),
    ("C", "root of C"),
    ("D", "pole of the noise filter"),
)
_RESPONSE = ["frequency_hz", "gain", "gain_lower", "gain_upper", "phase_deg"]


@dataclass(frozen=True)
class Channel:
    """An input or output."""

    name: str  # as recorded
    unit: str
    prepared: str  # after the transforms
    prepared_unit: str

    @property
    def recorded_label(self) -> str:
        """Name with unit, as recorded."""
        return with_unit(self.name, self.unit)

    @property
    def label(self) -> str:
        """Name with unit after the transforms."""
        return with_unit(self.prepared, self.prepared_unit)


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

    results: DatasetResults
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    model_text: str  # structure and orders
    order_name: str
    selected_order: int

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
            _spectrum_of(self.residuals_of(output), self.sampling_rate, RESIDUAL_NFFT)
            for output in self.outputs
        ]
        return _by_output(self.outputs, tables)

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

    # What the two kinds of results have in different forms.
    truth: Truth | None = None
    simulation: pd.DataFrame
    recorded_simulation: pd.DataFrame | None = None
    frequency_response: pd.DataFrame
    time_response: pd.DataFrame
    spectrum: pd.DataFrame
    peaks: Mapping[str, Sequence[SpectralPeak]]
    roots: pd.DataFrame
    poles_of_orders: Sequence[StabilizationPole]
    signals: pd.DataFrame
    convergence: Sequence[tuple[int, float]]
    modes: Sequence[Mode]
    trusted: Sequence[bool]
    candidates: pd.DataFrame | None = None
    scores: pd.DataFrame
    structure: str = ""
    has_poles_of_orders: bool = True

    # What the verdict rests on.
    evidence: Mapping[complex, ModeEvidence]  # of each tested mode, by its pole
    noise_modes: Sequence[Mode] = ()  # of the noise filter alone
    white: bool | None  # whether the residuals are; None where that is not known
    is_transformed: bool = False  # whether signals are differenced or transformed
    input_rests: bool = False  # on the validation samples
    recorded: RecordedErrors | None = None  # in recorded units, where transforms leave these

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


_FORMS = {
    "ss": "innovations",
    "ss_oe": "output error",
    "ss_oe_drift": "output error with drift",
    "ss_bj": "plant beside a noise model",
}


def structure_words(form: str) -> str:
    """What a structure is called."""
    return _FORMS[form] if form in _FORMS else structure_name(form)


def view_of(results: Results | View) -> View:
    """The view of results, of whatever channels."""
    if isinstance(results, View):
        return results
    return PolynomialView(results) if results.settings.is_single_channel else ChannelsView(results)


class PolynomialView(View):
    """Of a polynomial model with at most one input."""

    results: DatasetResults

    def __init__(self, results: DatasetResults) -> None:
        self.results = results
        recording, transforms = results.recording, results.model.transforms
        self.outputs = (
            Channel(
                recording.output_names[0],
                recording.output_units[0],
                prepared_output_name(transforms, recording.output_names[0]),
                prepared_output_unit(transforms, recording.output_units[0]),
            ),
        )
        self.inputs = tuple(
            Channel(name, unit, prepared_input_name(transforms, name), unit)
            for name, unit in zip(recording.input_names, recording.input_units, strict=True)
        )[: int(results.model.has_input)]
        self.model_text = str(results.model.orders)
        self.structure = results.model.structure
        self.order_name = plant_order(self.structure)
        self.truth = results.truth
        self.candidates = results.candidates
        validation = results.validation
        self.evidence = {each.mode.pole: each for each in validation.modes.modes}
        self.modes = [each.mode for each in validation.modes.modes]
        self.trusted = [each.trusted for each in validation.modes.modes]
        shared = {mode.pole for mode in results.model.modes}
        self.noise_modes = [mode for mode in results.model.noise_modes if mode.pole not in shared]
        self.white = white(validation)
        self.input_rests = input_rests(validation)
        self.is_transformed = transforms.changes_output or transforms.difference_input > 0
        self.recorded = validation.outputs[0].recorded if transforms.changes_output else None
        self.has_poles_of_orders = (
            self.structure != "fir" if results.decisions is not None else "joint" in results.phases
        )

    @property
    def selected_order(self) -> int:  # type: ignore[override]
        """That was selected where all orders were tied."""
        return int(getattr(self.results.models_of_orders.orders.single, self.order_name))

    @property
    def simulation(self) -> pd.DataFrame:
        """As in ``simulation.csv``."""
        return self.results.validation_tables.simulation

    @cached_property
    def recorded_simulation(self) -> pd.DataFrame | None:  # type: ignore[override]
        """In recorded units; None where the transforms leave these."""
        if self.recorded is None:
            return None
        (output,) = self.outputs
        names = ["recorded_output", "recorded_simulated", "recorded_predicted"]
        table = self.simulation[["time_s", *(f"{name}_{output.name}" for name in names)]]
        return table.set_axis(["time_s", *names], axis="columns")

    @cached_property
    def frequency_response(self) -> pd.DataFrame:
        """Of the model and its noise filter, then the multitaper estimate."""
        table, (output,) = self.results.frequency_response, self.outputs
        noise = table[["frequency_hz", *(f"noise_{name}" for name in _RESPONSE[1:])]]
        noise = noise.set_axis(_RESPONSE, axis="columns").assign(source="noise filter")
        noise = noise.assign(output=output.name)
        if not self.has_input:
            return noise[["source", "output", *_RESPONSE]]
        prefix = "frequency_response_"
        estimate = self.results.spectrum.rename(columns=lambda name: name.removeprefix(prefix))
        together = pd.concat(
            [
                table[_RESPONSE].assign(source="model"),
                noise,
                estimate[[*_RESPONSE, "coherence"]].assign(source="measured"),
            ],
            ignore_index=True,
        ).assign(output=output.name, input=self.inputs[0].name)
        return together[["source", "output", "input", *_RESPONSE, "coherence"]]

    @cached_property
    def time_response(self) -> pd.DataFrame:
        """Responses to a step and an impulse; without an input of the noise filter."""
        table = self.results.time_response.assign(output=self.outputs[0].name)
        return table.assign(input=self.inputs[0].name) if self.has_input else table

    @cached_property
    def spectrum(self) -> pd.DataFrame:
        """As in ``spectrum.csv``."""
        columns = ["frequency_hz", "density", "lower", "upper"]
        return _by_output(self.outputs, [self.results.spectrum[columns]])

    @property
    def peaks(self) -> Mapping[str, Sequence[SpectralPeak]]:  # type: ignore[override]
        """Of the spectrum."""
        return {self.outputs[0].name: self.results.spectrum_summary.peaks}

    @cached_property
    def roots(self) -> pd.DataFrame:
        """Roots of the polynomials with their covariances."""
        model = self.results.model.polynomials
        found = [
            (kind, root.value, root.covariance)
            for polynomial, kind in ROOTS
            for root in uncertain_roots(model, polynomial)
        ]
        true = [mode.pole for mode in self.truth.modes] if self.truth else []
        return _roots_table(found, true)

    @cached_property
    def poles_of_orders(self) -> list[StabilizationPole]:  # type: ignore[override]
        """Poles over the orders, each compared with the next lower order."""
        return stabilization(
            (getattr(each.orders.single, self.order_name), each.model, each.criteria.bic)
            for each in self.results.models_of_orders.candidates
        )

    @cached_property
    def signals(self) -> pd.DataFrame:
        """All channels as recorded and as used."""
        prepared, recording = self.results.prepared, self.results.recording
        begin = prepared.estimation.output.size / prepared.estimation.sampling_rate
        parts = []
        for stage, part, first in (
            ("recorded", recording, 0.0),
            ("estimation", prepared.estimation, 0.0),
            ("validation", prepared.validation, begin),
        ):
            inputs = [part.input] if recording.has_input else []
            parts.append(_stage(stage, part.sampling_rate, first, inputs, [part.output]))
        return _named_signals(parts, self.inputs[: int(recording.has_input)], self.outputs)

    @property
    def convergence(self) -> Sequence[tuple[int, float]]:  # type: ignore[override]
        """Evaluations and lowest objective of the search for the model."""
        return self.results.selected.diagnostics.convergence


class ChannelsView(View):
    """Of a model of several channels."""

    results: DatasetResults

    def __init__(self, results: DatasetResults) -> None:
        self.results = results
        model = results.model
        self.inputs, self.outputs = (
            tuple(Channel(name, unit, name, unit) for name, unit in zip(*each, strict=True))
            for each in (
                (model.input_names, model.input_units),
                (model.output_names, model.output_units),
            )
        )
        self.model_text = model.text
        self.order_name = "of the plant" if model.orders else "n"
        self.selected_order = results.validation.modes.order
        self.simulation = results.validation_tables.simulation
        self.convergence = model.search.diagnostics.convergence
        judged = results.validation.modes.modes
        self.modes = [each.mode for each in judged]
        self.trusted = [each.trusted for each in judged]
        self.evidence = {each.mode.pole: each for each in judged}
        self.white = white(results.validation)

    @cached_property
    def scores(self) -> pd.DataFrame:
        """Errors on held-out samples by structure and order, the choice selected."""
        choice = self.results.choice
        assert choice is not None
        chosen = choice.candidate.structure, choice.candidate.order
        rows = [
            (
                *(structure_words(each.structure), each.order, getattr(each.scores, choice.kind)),
                (each.structure, each.order) == chosen,
            )
            for search in self.results.searches
            for each in search.candidates
            if each.is_scored
        ]
        return pd.DataFrame(rows, columns=["structure", "order", "error_percent", "selected"])

    @cached_property
    def frequency_response(self) -> pd.DataFrame:
        """Of the model, then the measured one; without an input of the noise filter."""
        table = self.results.frequency_response
        if not self.has_input:
            return self._noise_response()
        names = {"measured_gain": "gain", "measured_phase_deg": "phase_deg"}
        measured = table[["output", "input", "frequency_hz", *names, "coherence"]]
        together = pd.concat(
            [
                table[["output", "input", *_RESPONSE]].assign(source="model"),
                measured.rename(columns=names).assign(source="measured"),
            ],
            ignore_index=True,
        )
        return together[["source", "output", "input", *_RESPONSE, "coherence"]]

    def _noise_response(self) -> pd.DataFrame:
        """From the innovations of each output to it."""
        names = {f"noise_{name}": name for name in _RESPONSE[1:]}
        table = self.results.frequency_response[["output", "frequency_hz", *names]]
        table = table.rename(columns=names).assign(source="noise filter")
        return table[["source", "output", *_RESPONSE]]

    @cached_property
    def time_response(self) -> pd.DataFrame:
        """Responses to steps and impulses at each input; without an input none."""
        if not self.has_input:
            return pd.DataFrame()
        impulse = self.results.model.plant.impulse_response(RESPONSE_SAMPLES)
        times = np.arange(RESPONSE_SAMPLES) / self.sampling_rate
        unknown = {
            f"{name}_{end}": np.nan for name in ("impulse", "step") for end in ("lower", "upper")
        }
        return pd.concat(
            [
                pd.DataFrame(
                    {
                        "output": output.name,
                        "input": source.name,
                        "time_s": times,
                        "impulse": impulse[:, row, column],
                        "step": np.cumsum(impulse[:, row, column]),
                        **unknown,
                    }
                )
                for row, output in enumerate(self.outputs)
                for column, source in enumerate(self.inputs)
            ],
            ignore_index=True,
        )

    @cached_property
    def _spectra(self) -> list[tuple[pd.DataFrame, Sequence[SpectralPeak]]]:
        """Spectrum and peaks of each prepared output."""
        samples = self.results.prepared.estimation.longest
        found: list[tuple[pd.DataFrame, Sequence[SpectralPeak]]] = []
        for column in samples.outputs.T:
            table = _spectrum_of(column, self.sampling_rate, SPECTRUM_NFFT)
            peaks: Sequence[SpectralPeak] = ()
            if len(table):
                estimate = multitaper_spectrum(column, self.sampling_rate, nfft=SPECTRUM_NFFT)
                peaks = spectral_peaks(estimate)
            found.append((table.drop(columns="white_level"), peaks))
        return found

    @property
    def spectrum(self) -> pd.DataFrame:
        """Multitaper spectra of the prepared outputs."""
        return _by_output(self.outputs, [table for table, _ in self._spectra])

    @property
    def peaks(self) -> Mapping[str, Sequence[SpectralPeak]]:  # type: ignore[override]
        """Of each spectrum."""
        return {o.name: found for o, (_, found) in zip(self.outputs, self._spectra, strict=True)}

    @cached_property
    def roots(self) -> pd.DataFrame:
        """Poles of the model, without their covariances, and roots of its predictor."""
        model, unknown = self.results.model.state_space, np.full((2, 2), np.nan)
        kinds = (("pole", model.poles()), ("root of C", model.predictor_poles()))
        shown = kinds if self.results.model.has_noise_model else kinds[:1]
        return _roots_table([(kind, root, unknown) for kind, roots in shown for root in roots], [])

    @cached_property
    def poles_of_orders(self) -> list[StabilizationPole]:  # type: ignore[override]
        """Poles over the orders, each compared with the next lower order."""
        by_order: dict[int, list[Any]] = {
            order: [] for order in self.results.validation.modes.orders
        }
        for pole in self.results.validation.modes.poles:
            by_order.setdefault(pole.order, []).append(pole)
        return stabilization_of_modes(by_order)

    @cached_property
    def signals(self) -> pd.DataFrame:
        """All channels as used."""
        prepared = self.results.prepared
        begin = prepared.estimation.samples / self.sampling_rate
        parts = [
            _stage(stage, self.sampling_rate, first, [*part.inputs.T], [*part.outputs.T])
            for stage, part, first in (
                ("estimation", prepared.estimation, 0.0),
                ("validation", prepared.validation, begin),
            )
        ]
        return _named_signals(parts, self.inputs, self.outputs)


def _by_output(outputs: Sequence[Channel], tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Tables of the outputs one below the other, with a first column that names the output."""
    named = [
        table.assign(output=output.name)[["output", *table.columns]]
        for output, table in zip(outputs, tables, strict=True)
    ]
    return pd.concat(named, ignore_index=True)


def _spectrum_of(signal: np.ndarray, rate: float, nfft: int) -> pd.DataFrame:
    """Multitaper spectrum with its band and the level of white noise; empty for a short signal."""
    columns = ["frequency_hz", "density", "lower", "upper", "white_level"]
    try:
        found = multitaper_spectrum(signal, rate, nfft=nfft)
    except InputError:
        return pd.DataFrame(columns=columns, dtype=float)
    values = (found.frequencies, found.density, found.lower, found.upper)
    table = pd.DataFrame(dict(zip(columns, values, strict=False)))
    return table.assign(white_level=2.0 * float(np.var(signal)) / rate)


def _roots_table(
    found: Sequence[tuple[str, complex, np.ndarray]], true: Sequence[complex]
) -> pd.DataFrame:
    unknown = np.full((2, 2), np.nan)
    both = [root for pole in true for root in (pole, pole.conjugate())]
    rows = [
        (kind, root.real, root.imag, abs(root), c[0, 0], c[1, 1], c[0, 1])
        for kind, root, c in [*found, *(("true pole", root, unknown) for root in both)]
    ]
    columns = ["kind", "real", "imag", "radius", "variance_real", "variance_imag", "covariance"]
    return pd.DataFrame(rows, columns=columns)


def _stage(
    stage: str, rate: float, begin: float, inputs: Sequence[np.ndarray], outputs: Sequence[Any]
) -> pd.DataFrame:
    signals = [*inputs, *outputs]
    time = begin + np.arange(len(signals[-1])) / rate
    return pd.DataFrame({"stage": stage, "time_s": time} | dict(enumerate(signals)))


def _named_signals(
    parts: Sequence[pd.DataFrame], inputs: Sequence[Channel], outputs: Sequence[Channel]
) -> pd.DataFrame:
    names = [*(f"input_{each.name}" for each in inputs), *(f"output_{o.name}" for o in outputs)]
    return pd.concat(parts, ignore_index=True).rename(columns=dict(enumerate(names)))


def stabilization_table(view: View) -> pd.DataFrame:
    """Poles over the orders, each with its status."""
    columns = ["order", "frequency_hz", "damping_ratio", "status"]
    table = pd.DataFrame([asdict(pole) for pole in view.poles_of_orders], columns=columns)
    table.insert(2, "damping_percent", 100 * table.pop("damping_ratio"))
    return table
